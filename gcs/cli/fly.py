"""`gcs fly gamepad`: the leader, or one drone in HOLD, by hand."""

import asyncio
import math
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any

import typer

from formation.requests import GCS_NAME, OperatorReply, OperatorRequest, Verb, answer_s
from gcs.cli.operator import Identity, Lab, offered_bodies
from mavlink_formation.installation import install_command
from wire import clock
from wire.errors import BusError, ConfigError
from wire.process.program import Insecure, Name, bodies_of, fail, lab_near, print_error
from wire.process.system import NO_GROUND, NOT_RIGHT, REJECTED, own_name

if TYPE_CHECKING:
    from gcs.gamepad import Device, Gamepad
    from wire.security.protection import Protection
    from wire.transport.lab_address import LabAddress

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Fly a drone by hand, by velocity, in the fence.")


@app.callback()
def _group() -> None:
    """Keeps `gamepad` a command of its own."""


@app.command()
def gamepad(
    lab: Lab = None,
    body: Annotated[
        str, typer.Option(help="Whom; the leader of the lab file if not given.", autocompletion=offered_bodies)
    ] = "",
    device: Annotated[str, typer.Option(help="/dev/input/event...; the first gamepad if not given.")] = "",
    speed: Annotated[
        float, typer.Option(min=0.01, max=3.0, metavar="M/S", help="At full stick; the lab limits it.")
    ] = 0.3,
    turn: Annotated[float, typer.Option(min=0.0, max=1.0, metavar="RAD/S", help="At full stick.")] = 0.5,
    facing: Annotated[
        float, typer.Option(metavar="DEG", help="Which heading in the lab is ahead: where you look.")
    ] = 0.0,
    name: Name = GCS_NAME,
    identity: Identity = "",
    insecure: Insecure = False,
) -> None:
    """Fly the leader in FORMATION, or any one drone in HOLD, while a button over the triggers is held. Needs [gamepad].

    Left stick: height, turn; right stick: ahead, aside. Let go of the button, or pull the gamepad: it holds.
    """
    from gcs.gamepad import Axis, Gamepad, sticks_of
    from wire.security.protection import Protection
    from wire.transport.lab_address import address_near

    body = body or next(iter(bodies_of(lab_near(lab))), "")
    if not body:
        fail("--body: whom? There is no lab file here that names a leader", NOT_RIGHT)
    opened = _opened(device)
    sticks = sticks_of(axis for axis in Axis if axis in dict(opened.capabilities().get(3, ())))
    if sticks is None:
        fail(f"{opened.path} ({opened.name}) has no two sticks", NOT_RIGHT)
    ranges: dict[int, tuple[int, int]] = {axis: (opened.absinfo(axis).min, opened.absinfo(axis).max) for axis in sticks}
    pad = Gamepad(ranges, sticks, speed, turn, math.radians(facing))
    typer.echo(f"{opened.name} flies {body} while a button over the triggers is held; Ctrl-C ends", err=True)
    try:
        where = address_near(lab)
        asyncio.run(_fly(opened, pad, body, where, Protection(where.access(identity, insecure)), name))
    except KeyboardInterrupt:
        return
    except TimeoutError as error:
        fail(f"no ground answers: {error}; it holds by itself", NO_GROUND)
    except (BusError, ConfigError) as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(f"{opened.path}: {error.strerror or error}: held", REJECTED)


def _opened(path: str) -> Any:
    """The device, evdev's; ends the program where there is none, or it may not be read."""
    try:
        evdev = import_module("evdev")
    except ModuleNotFoundError:
        fail(f"evdev is not here: {install_command('gamepad')}", NOT_RIGHT)
    try:
        found = map(evdev.InputDevice, (path,) if path else evdev.list_devices())
        opened = next((one for one in found if path or evdev.ecodes.BTN_GAMEPAD in one.capabilities().get(1, ())), None)
    except OSError as error:
        fail(f"{path or error.filename}: {error.strerror}", NOT_RIGHT)
    if opened is None:
        fail("no gamepad under /dev/input that you may read: plug it in; be in the group `input`", NOT_RIGHT)
    return opened


async def _fly(
    device: "Device", pad: "Gamepad", body: str, where: "LabAddress", protection: "Protection", name: str
) -> None:
    from formation.link_config import LinkConfig
    from gcs.gamepad import fly
    from wire.transport.zenoh_bus import ZenohBus

    bus = await ZenohBus.open(LinkConfig(zenoh_connect=where.endpoints), where.lab, protection=protection)

    async def ask(verb: Verb, argument: str) -> OperatorReply:
        return await bus.ask(name, OperatorRequest(clock.unix_us(), verb, argument, own_name()), answer_s(verb))

    try:
        await fly(device, pad, body, ask, print_error, clock.REAL_TIME)
    finally:
        await bus.close()
