"""`gcs`: the ground daemon, and the operator's commands that reach it over the lab's bus. See gcs.cli.app.

Exit codes: 0 done; 1 refused, failed, or a check failed; 2 the command line, a configuration or a recording is not
right; 3 no ground answers.
"""

import sys


def main() -> None:
    """The console script."""
    try:
        _run()
    except SystemExit as end:
        from wire.process.system import end_beside_closing

        end_beside_closing(end)
        raise


def _run() -> None:
    """A stop goes its own short way: the whole command line takes three times as long to load."""
    if sys.argv[1:2] == ["stop"]:
        from wire.process.system import run_before_others

        run_before_others()  # before anything is loaded, where the machine allows it
        from gcs.cli.stop import stop
        from wire.process.output import dropping_output

        with dropping_output():  # the exit code is its answer, whatever reads its words
            code = stop(sys.argv[2:])
        if code is not None:
            raise SystemExit(code)
    from gcs.cli.app import app

    app()


if __name__ == "__main__":
    main()
