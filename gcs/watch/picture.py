"""What `gcs watch` prints: phase, table, alarms, in 80 columns. Pure."""

from rich.console import Group
from rich.table import Table
from rich.text import Text

from gcs.page.show import Show
from gcs.page.table import COLUMNS, UNITS, Cell, Level
from gcs.state.alarms import Alarm

LEFT_OUT = ("landed", "make", "batt")
STYLES = {Level.CALM: "", Level.WARN: "yellow", Level.BAD: "bold red"}
MOST_ALARMS = 6
NARROW = {"mode": 8, "name": 9, "validator": 9}


def picture(shown: Show, alarms: tuple[Alarm, ...], answer: str) -> Group:
    """The whole screen."""
    if shown.lost:
        head = Text(f" NO CONNECTION TO THE GROUND: {shown.lost} ", "bold white on red")
    else:
        head = Text.assemble((f" {shown.phase} ", "bold reverse"), f" {shown.since}  {shown.cause}")
    parts = [head]
    parts += [Text(text, "bold yellow") for text in shown.countdowns]
    parts += [Text(shown.stop, "bold white on red")] if shown.stop else []
    vital = Text("  ").join(Text.assemble(f"{name} ", (cell.text, STYLES[cell.level])) for name, cell in shown.vital)
    against = [
        Text(f"no {step.verb}: {reason}", "yellow")
        for step in shown.steps
        for reason in step.reasons
        if not step.out_of_turn
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
        table.add_column(
            f"{name}\n{UNITS[i]}", no_wrap=True, justify="left" if words else "right", max_width=NARROW.get(name)
        )
    for row in shown.rows:
        table.add_row(*(_text(row[i]) for i in columns))
    return table


def _text(cell: Cell) -> Text:
    return Text(cell.text, STYLES[cell.level])
