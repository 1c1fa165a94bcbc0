"""Code that all command lines share: how they are made, options, exit codes, the lab file, errors, completion."""

import inspect
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, TypeVar, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from formation.names import meant
from wire import version
from wire.errors import ConfigError
from wire.files import read_toml
from wire.process.system import NOT_RIGHT, REJECTED

if TYPE_CHECKING:
    from formation.config import LabConfig
    from formation.messages import Event

_AS_JSON = ContextVar("_AS_JSON", default=False)
"""Whether `--json` is on the command line that runs."""


def program(help_text: str, epilog: str) -> typer.Typer:
    """A command line with commands; plain text, since laying it out richly costs more than saying it."""
    app = typer.Typer(
        cls=Program, pretty_exceptions_enable=False, no_args_is_help=True, rich_markup_mode=None, help=help_text,
        epilog=epilog,
    )  # fmt: skip
    app.callback()(_options)
    return app


@contextmanager
def progress_line(name: str) -> Iterator[Callable[[str], None]]:
    """A line that says how far a task is, renewed at each call; nothing where nobody looks on."""

    def show(text: str) -> None:
        if sys.stderr.isatty():
            print(f"\r{f'{name}: {text}'[:78]:78}", end="", file=sys.stderr, flush=True)

    try:
        yield show
    finally:
        if sys.stderr.isatty():
            print(f"\r{'':78}\r", end="", file=sys.stderr, flush=True)


def print_json_error(text: str) -> None:
    """With `--json`, print an error as JSON on standard output, where a script reads the result."""
    if _AS_JSON.get():
        print(json.dumps({"error": text}), flush=True)


class _JsonErrors:
    """A command line whose own errors are JSON where `--json` is given; to be mixed with typer's classes."""

    def main(self, *arguments: Any, **extra: Any) -> Any:
        """Parse and run; ends the process. The parameters are click's, its `args` the first."""
        args = arguments[0] if arguments else extra.get("args")
        if "--json" not in (sys.argv[1:] if args is None else args):
            return super().main(*arguments, **extra)  # type: ignore[misc]
        before = _AS_JSON.set(True)
        try:
            sys.exit(super().main(*arguments, **extra | {"standalone_mode": False}))  # type: ignore[misc]
        except Exception as error:
            # Of click's class, or of the copy that newer versions of typer bring along.
            if not hasattr(error, "format_message"):
                raise
            _end_with(error)
        finally:
            _AS_JSON.reset(before)


def _end_with(error: Any) -> NoReturn:
    print_json_error(error.format_message())
    error.show()
    sys.exit(error.exit_code)


class Program(_JsonErrors, TyperGroup):
    """The command line of a program with commands."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command of the first argument; what may be meant by one that is none."""
        names = self.list_commands(ctx)
        if args[0] not in names and (near := meant(args[0], names)):
            ctx.fail(f"no command {args[0]!r}{near}")
        return super().resolve_command(ctx, args)


class SingleProgram(_JsonErrors, TyperCommand):
    """The command line of a program without commands."""


class DefaultCommand(TyperGroup):
    """Commands of which the first is meant where none is named: `gcs mocap lab.toml` is `gcs mocap serve lab.toml`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the first command's name in front, unless one is named or help is wanted."""
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = [next(iter(self.commands)), *args]
        return super().parse_args(ctx, args)


Options = TypeVar("Options")


def with_options(options: type[Options]) -> Callable[[Callable[[Options], None]], Callable[..., None]]:
    """Pass a command all its options as one dataclass; its fields are annotated as typer's parameters are."""

    def decorate(command: Callable[[Options], None]) -> Callable[..., None]:
        def run(**arguments: object) -> None:
            command(options(**arguments))

        run.__name__, run.__doc__ = command.__name__, command.__doc__
        run.__signature__ = inspect.signature(options)  # type: ignore[attr-defined]
        run.__annotations__ = get_type_hints(options, include_extras=True)
        return run

    return decorate


def _show(wanted: bool) -> None:
    if wanted:
        typer.echo(version.text())
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=_show, is_eager=True, help="Show release and commit, and end.")
]


def _options(_version: Version = False) -> None:
    pass


COLOURS = {"WARNING": "yellow", "ERROR": "red", "CRITICAL": "bright_red", "EMERGENCY": "bright_red"}

Name = Annotated[str, typer.Option("--name", help="Which ground of the lab.")]
Speed = Annotated[float, typer.Option(min=0.01, max=1.0, hidden=True)]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for scripts.")]
Overwrite = Annotated[
    bool,
    typer.Option("--overwrite", help="Write over what is there; else the next free name is taken, or it is refused."),
]
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Simulation only: open links to other machines without any keys.")
]
LabFile = Annotated[Path, typer.Argument(metavar="LAB.TOML", help="The lab: bodies, drones, limits, links, mocap.")]


def configuration(path: Path) -> "LabConfig":
    """The lab in the file; ends the program where it is not right."""
    from formation.config import LabConfig
    from wire.config_file import load

    try:
        return load(path, LabConfig)
    except ConfigError as error:
        fail(str(error), NOT_RIGHT)


def print_error(text: str) -> None:
    """Print a line on standard error; red on a terminal."""
    typer.secho(text, fg="red", err=True)


def fail(text: str, code: int) -> NoReturn:
    """Print an error and end the program with an exit code."""
    print_json_error(text)
    print_error(f"gcs: {text}")
    raise typer.Exit(code)


@contextmanager
def refusing(*not_right: type[Exception]) -> Iterator[None]:
    """Turn a configuration, keys, or more that is not right, and what the system refuses, into one line and the end."""
    not_right = (ConfigError, *not_right)
    try:
        yield
    except not_right as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(str(error), REJECTED)


def print_event(event: "Event") -> None:
    """Print one line on standard error, for people."""
    typer.secho(f"{event.source}: {event.text}", fg=COLOURS.get(event.severity.name), err=True)


def print_event_json(event: "Event") -> None:
    """Print one line of JSON on standard output, for scripts."""
    print(json.dumps({"severity": event.severity.name, "source": event.source, "text": event.text}), flush=True)


LAB = Path("lab.toml")


def starting(names: Iterable[str], incomplete: str) -> list[str]:
    """Those of the names that begin with what was typed, for the Tab key."""
    return [name for name in names if name.startswith(incomplete)]


def lab_near(argument: object) -> dict[str, Any]:
    """The values in the lab file of the argument, or else in `lab.toml` here; empty where it cannot be read."""
    try:
        return read_toml(LAB if argument is None else Path(str(argument)))
    except ConfigError:
        return {}


def bodies_of(lab: dict[str, Any]) -> list[str]:
    """The names of its vehicles, leader first."""
    followers = lab.get("followers", [])
    entries = [lab.get("leader"), *(followers if isinstance(followers, list) else ())]
    return [str(entry["body"]) for entry in entries if isinstance(entry, dict) and "body" in entry]


def keys_of(lab: dict[str, Any], table: str, key: str) -> list[str]:
    """The names in a table of a table."""
    entries = lab.get(table, {})
    named = entries.get(key, {}) if isinstance(entries, dict) else {}
    return list(named) if isinstance(named, dict) else []
