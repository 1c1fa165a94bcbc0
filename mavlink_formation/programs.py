"""How each program starts: it imports what is installed, whatever PYTHONPATH and the working folder hold.

A sourced workspace may hold packages named `gcs`, `sim` or `wire`; this one's name is nobody else's. PYTHONPATH is
searched after everything that is installed, so that a lab's own packages are still found there.
"""

import errno
import io
import json
import os
import runpy
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module

_INSTALLATION = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_EXTRAS = {
    "ground": (
        "cryptography", "foxglove_schemas_protobuf", "google", "lz4", "mcap", "mcap_protobuf", "qtm_rt", "rich",
        "tomli_w", "zstandard",
    ),
    "page": ("nicegui", "uvicorn"),
    "report": ("jinja2", "markupsafe", "matplotlib", "scipy"),
    "doctor": ("mavsdk",),
    "metrics": ("prometheus_client",),
}  # fmt: skip
"""What each optional part of the installation brings, as it is imported."""
_NOT_RIGHT = 2  # wire.process.system
_OUTPUT_ERRORS = (errno.EPIPE, errno.ENOSPC, errno.EDQUOT, errno.EIO)


def gcs() -> None:
    """The console script."""
    _run(lambda: import_module("gcs.__main__").main())


def drone_agent() -> None:
    """The console script."""
    _run(lambda: import_module("drone_agent.__main__").app())


def gcs_sim() -> None:
    """The console script."""
    _run(lambda: import_module("sim.cli.app").main())


def gcs_log() -> None:
    """The console script."""
    _run(lambda: import_module("sim.cli.log").main())


def module() -> None:
    """Run the module named by the first argument, as `python -m` does."""
    del sys.argv[0]
    _run(lambda: runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True))


def _run(main: Callable[[], object]) -> None:
    _search_installation_first()
    _open_closed_streams()
    try:
        try:
            main()
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:  # while a command is still being loaded
        sys.exit(130)
    except ModuleNotFoundError as error:
        _end_without_extra(error)
    except OSError as error:
        if error.errno not in _OUTPUT_ERRORS or error.filename is not None:
            raise
        _end_without_output(error)


def _search_installation_first() -> None:
    own = [os.path.abspath(folder) for folder in os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    others = [folder for folder in sys.path if os.path.abspath(folder) not in (_INSTALLATION, *own)]
    sys.path[:] = [*others, _INSTALLATION, *own]


def _open_closed_streams() -> None:
    """Open the null device where a standard stream is closed: else a socket gets its number, and its text.

    An open one takes any text, whatever its encoding.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # what it cannot show
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            with suppress(OSError):
                os.fstat(number)
                continue
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115


def _end_without_extra(error: ModuleNotFoundError) -> None:
    """End with one line where an optional part of the installation is missing; else it is our own fault, and raised."""
    root = (error.name or "").partition(".")[0]
    extra = next((extra for extra, roots in _EXTRAS.items() if root in roots), None)
    if extra is None:
        raise error
    from mavlink_formation.installation import install_command

    text = f"needs {root}, which is not installed: {install_command(extra)}"
    if "--json" in sys.argv:
        print(json.dumps({"error": text}))
    sys.stderr.write(f"{os.path.basename(sys.argv[0])}: {text}\n")
    sys.exit(_NOT_RIGHT)


def _end_without_output(error: OSError) -> None:
    """End with exit code 1; a reader that closes early (`| head`) is no fault to speak of."""
    with suppress(OSError):
        if error.errno != errno.EPIPE:
            sys.stderr.write(f"{os.path.basename(sys.argv[0])}: output is lost: {error.strerror}\n")
    null = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):  # what is still buffered is lost quietly
        os.dup2(null, number)
    sys.exit(1)
