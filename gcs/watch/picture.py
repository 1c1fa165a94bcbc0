"""What `gcs watch` prints: phase, table, alarms, in 80 columns. Pure."""

from rich.console import Group, JustifyMethod
from rich.table import Table
from rich.text import Text

from gcs.page.show import LABELS, Show, not_landed_text
from gcs.page.table import COLUMNS, UNITS, Cell, Level
from wire.ground_state import Alarm

LEFT_OUT = ("landed", "make", "batt")
STYLES = {Level.CALM: "", Level.WARN: "yellow", Level.BAD: "bold red"}
MOST_ALARMS = 6
NARROW = {"mode": 8, "name": 9, "validator": 9}
HEADS = {"setpoint": "set-\npoint", "charge": "\nbatt"}


def picture(shown: Show, alarms: tuple[Alarm, ...], answer: str) -> Group:
    """The whole screen."""
    if shown.lost:
        head = Text(f" NO CONNECTION TO THE GROUND: {shown.lost} ", "bold white on red")
    else:
        head = Text.assemble(
            (f" {'-' if shown.phase is None else shown.phase.name} ", "bold reverse"), f" {shown.since}  {shown.cause}"
        )
    parts = [head]
    parts += [Text(text, "bold yellow") for text in shown.countdowns]
    parts += [Text(text, "bold white on red") for text in (not_landed_text(shown.not_landed), shown.stop) if text]
    vital = Text("  ").join(Text.assemble(f"{name} ", (cell.text, STYLES[cell.level])) for name, cell in shown.vital)
    against = [
        Text(f"{LABELS[step.verb]} is not possible: {reason}", "yellow")
        for step in shown.steps
        for reason in step.reasons
        if not step.is_idle
    ]
    alarm_lines = [
        Text(f"{alarm.severity.name} {alarm.source}: {alarm.text}", "red" if alarm.acknowledged else "bold red")
        for alarm in alarms[:MOST_ALARMS]
    ]
    keys = Text("H hold   L land   SPACE STOP   A acknowledge   Q quit", "dim")
    return Group(*parts, _table(shown), vital, *against[:MOST_ALARMS], *alarm_lines, Text(answer, "bold"), keys)


def _table(shown: Show) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0))
    columns = [i for i, name in enumerate(COLUMNS) if name not in LEFT_OUT]
    for i in columns:
        name = COLUMNS[i]
        words = name in ("name", "mode", "validator")
        head = HEADS.get(name, f"\n{name}")
        justify: JustifyMethod = "left" if words else "right"
        table.add_column(f"{head}\n{UNITS[i]}", no_wrap=True, justify=justify, max_width=NARROW.get(name))
    for row in shown.rows:
        table.add_row(*(_text(row[i]) for i in columns))
    return table


def _text(cell: Cell) -> Text:
    return Text(cell.text, STYLES[cell.level])
