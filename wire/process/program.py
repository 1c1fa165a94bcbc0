"""What every program has alike: how its command line is made, and `--version`."""

import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar, get_type_hints

import typer
from typer.core import TyperGroup

from wire import version


def program(help_text: str, epilog: str) -> typer.Typer:
    """A command line with commands; plain text, since laying it out richly costs more than saying it."""
    app = typer.Typer(
        pretty_exceptions_enable=False, no_args_is_help=True, rich_markup_mode=None, help=help_text, epilog=epilog
    )
    app.callback()(_options)
    return app


class DefaultCommand(TyperGroup):
    """Commands of which the first is meant where none is named: `gcs mocap lab.toml` is `gcs mocap serve lab.toml`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the first command's name in front, unless one is named or help is wanted."""
        if args and args[0] not in (*self.commands, *ctx.help_option_names):
            args = [next(iter(self.commands)), *args]
        return super().parse_args(ctx, args)


Given = TypeVar("Given")


def takes(options: type[Given]) -> Callable[[Callable[[Given], None]], Callable[..., None]]:
    """Give a command all its options as one dataclass, whose fields are annotated as typer has it for parameters."""

    def decorate(command: Callable[[Given], None]) -> Callable[..., None]:
        def run(**given: object) -> None:
            command(options(**given))

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
