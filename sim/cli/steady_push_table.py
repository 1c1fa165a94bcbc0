"""What `gcs-sim steady-push` found, as a table."""

from collections.abc import Sequence

from rich.table import Table

from sim.studies.push import Settling
from sim.studies.steady_push import Push


def steady_push_table(jobs: Sequence[Push], flown: Sequence[Settling]) -> Table:
    """A row a flight; red: it swings on."""
    table = Table(title="a push that begins at once and stays")
    for heading in (
        "controller",
        "push, of the tilt limit",
        "motor lag",
        "seed",
        "swing, deg",
        "settles in, s",
        "off, mm",
    ):
        table.add_column(heading, justify="left" if heading == "controller" else "right")
    for job, settling in zip(jobs, flown, strict=True):
        figures = (f"{settling.swing_deg:.2f}", f"{settling.settle_s:.2f}", f"{1e3 * settling.deviation_m:.0f}")
        row = (job.controller, f"{job.share:g}", f"x {job.motor_lag:g}", str(job.seed), *figures)
        table.add_row(*row, style=None if settling.at_rest else "red")
    return table
