"""What every program has alike: how its command line is made, and `--version`."""

from typing import Annotated

import typer

from wire import version


def program(help_text: str, epilog: str) -> typer.Typer:
    """A command line with commands; plain text, since laying it out richly costs more than saying it."""
    app = typer.Typer(
        pretty_exceptions_enable=False, no_args_is_help=True, rich_markup_mode=None, help=help_text, epilog=epilog
    )
    app.callback()(_options)
    return app


def _show(wanted: bool) -> None:
    if wanted:
        typer.echo(version.text())
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=_show, is_eager=True, help="Show release and commit, and end.")
]


def _options(_version: Version = False) -> None:
    pass
