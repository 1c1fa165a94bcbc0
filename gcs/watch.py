"""`gcs watch`: the page's table in a terminal, in 80 columns, and its keys."""

import asyncio
import os
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console, Group, JustifyMethod
from rich.live import Live
from rich.table import Table
from rich.text import Text

from formation.config import LinkConfig
from formation.messages import OperatorRequest, Verb
from formation.requests import answer_s
from gcs.alarms import ShownAlarms, folded, style
from gcs.page.show import COLUMNS, LABELS, MOCAP_LOST_NS, UNITS, Cell, Level, Show, none_of_ours, not_landed_text, show
from wire import clock
from wire.errors import BusError, ConfigError
from wire.ground_state import Alarm, GroundState, decode
from wire.process.program import fail
from wire.process.system import NOT_RIGHT, own_name
from wire.security.protection import Protection
from wire.transport.lab_address import LabAddress, address_near
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

LEFT_OUT = ("landed", "make", "batt")
STYLES = {Level.CALM: "", Level.WARN: "yellow", Level.BAD: "bold red"}
MOST_ALARMS = 6
NARROW = {"mode": 8, "name": 9, "validator": 9}
HEADS = {"setpoint": "set-\npoint", "charge": "\nbatt"}
KEYS = {" ": Verb.STOP, "h": Verb.HOLD, "l": Verb.LAND, "a": Verb.ACKNOWLEDGE}


def picture(shown: Show, alarms: tuple[Alarm, ...], answer: str) -> Group:
    """The whole screen."""
    if shown.lost:
        head = Text(f" NO CONNECTION TO THE GROUND: {shown.lost} ", "bold white on red")
    else:
        head = Text.assemble(
            (f" {'-' if shown.phase is None else shown.phase.name} ", "bold reverse"),
            *((f" {text} ", "bold yellow") for text in (shown.left_out,) if text),
            f" {shown.since}  {shown.cause}",
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
    standing, others = folded(alarms, MOST_ALARMS)
    alarm_lines = [Text(alarm.line, style(alarm), no_wrap=True, overflow="ellipsis") for alarm in standing]
    alarm_lines += [Text(f"alarms: {others}", "dim")] if others else []
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


def watch(lab: Path | None, name: str, identity: str = "", insecure: bool = False) -> None:
    """Show the ground until Q or Ctrl-C; ends the program where the lab or its bus is not right."""
    if not sys.stdin.isatty():
        fail("watch reads keys from a terminal, standard input is none: scripts use `gcs status --json`", NOT_RIGHT)
    try:
        where = address_near(lab)
        with _single_keys():
            asyncio.run(_Watch(name).run(where, Protection(where.access(identity, insecure))))
    except KeyboardInterrupt:
        return
    except (BusError, ConfigError) as error:
        fail(str(error), NOT_RIGHT)


class _Watch:
    def __init__(self, name: str) -> None:
        self._name = name
        self._alarms = ShownAlarms()
        self._state: GroundState | None = None
        self._mocap: dict[str, Any] | None = None
        self._state_ns = self._mocap_ns = 0
        self._answer = ""
        self._quit = asyncio.Event()
        self._asking: set[asyncio.Task[None]] = set()

    async def run(self, where: LabAddress, protection: Protection) -> None:
        """Until Q."""

        bus = await ZenohBus.open(LinkConfig(zenoh_connect=where.endpoints), where.lab, protection=protection)

        def receive_state(text: str) -> None:
            try:
                state = decode(text)
                with none_of_ours("ground"):
                    show(state, self._mocap, 0.0)
                    self._alarms.receive_ground(state)
            except ValueError as error:
                self._answer = f"refused: {error}"
                return
            self._state, self._state_ns = state, clock.monotonic_ns()

        def receive_mocap_state(state: dict[str, Any]) -> None:
            try:
                with none_of_ours("mocap process"):
                    show(self._state, state, 0.0)
            except ValueError as error:
                self._answer = f"refused: {error}"
                return
            self._mocap, self._mocap_ns = state, clock.monotonic_ns()

        bus.on_state(self._name, receive_state)
        MocapBus(bus).on_state(receive_mocap_state)
        loop = asyncio.get_running_loop()
        keyboard = sys.stdin.fileno()
        loop.add_reader(keyboard, lambda: self._press(os.read(keyboard, 64).decode(errors="replace"), bus))
        try:
            with Live(console=Console(), screen=True, auto_refresh=False) as live:
                while not self._quit.is_set():
                    now_ns = clock.monotonic_ns()
                    mocap = self._mocap if now_ns - self._mocap_ns < MOCAP_LOST_NS else None
                    shown = show(self._state, mocap, (now_ns - self._state_ns) * 1e-9)
                    live.update(picture(shown, self._alarms.open, self._answer), refresh=True)
                    await asyncio.sleep(0.1)
        finally:
            loop.remove_reader(keyboard)
            await bus.close()

    def _press(self, keys: str, bus: ZenohBus) -> None:
        for key in keys.lower():
            if key == "q":
                self._quit.set()
            elif key in KEYS:
                if KEYS[key] is Verb.ACKNOWLEDGE:
                    self._alarms.acknowledge()
                task = asyncio.create_task(self._ask(KEYS[key], bus))
                self._asking.add(task)
                task.add_done_callback(self._asking.discard)

    async def _ask(self, verb: Verb, bus: ZenohBus) -> None:
        self._answer = f"{verb} ..."
        try:
            request = OperatorRequest(clock.unix_us(), verb, source=own_name())
            reply = await bus.ask(self._name, request, answer_s(verb))
        except TimeoutError as error:
            self._answer = f"no ground answers: {error}"
        else:
            self._answer = f"{verb}: {reply.text}" if reply.accepted else f"{verb} refused: {reply.text}"


@contextmanager
def _single_keys() -> Iterator[None]:
    """While inside, a key is read when it is pressed."""
    keyboard = sys.stdin.fileno()
    before = termios.tcgetattr(keyboard)
    tty.setcbreak(keyboard)
    try:
        yield
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
