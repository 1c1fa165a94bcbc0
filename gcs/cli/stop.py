"""`gcs stop`, and nothing else: loads the bus alone, since what is loaded is what a stop waits for.

Its protocol is that of every other command (wire.transport.zenoh_session.ask); only the command line is read here.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from formation.requests import OperatorRequest, Verb
from gcs import GCS_NAME
from gcs.cli.exit_codes import NO_GROUND, NOT_RIGHT, REFUSED
from wire import clock
from wire.errors import BusError, ConfigError

ANSWER_S = 3.0
_OPTIONS = ("--lab", "--name", "--timeout")


def stop(words: Sequence[str]) -> int | None:
    """Stop the swarm as those words after `stop` say; the exit code, None where they are not understood here.

    `--help`, `--json` and mistakes are left to the whole command line, which has an answer for each.
    """
    given = dict.fromkeys(_OPTIONS, "")
    rest = list(words)
    while rest:
        name, equals, value = rest.pop(0).partition("=")
        if name not in given or not (equals or rest):
            return None
        given[name] = value if equals else rest.pop(0)
    try:
        timeout_s = float(given["--timeout"]) if given["--timeout"] else None
    except ValueError:
        return None
    return _ask(given["--lab"], given["--name"] or GCS_NAME, timeout_s)


def _ask(lab: str, name: str, timeout_s: float | None) -> int:
    from wire.transport.lab_address import LabAddress, address_in
    from wire.transport.zenoh_session import Patience, ask

    # Without a time given it is tried for as long as there is anybody on the bus.
    patience = Patience(ANSWER_S, ground_s=ANSWER_S) if timeout_s is None else Patience.throughout(timeout_s)

    try:
        where = address_in(Path(lab)) if lab else LabAddress()
        reply = ask(where.endpoints, where.lab, name, OperatorRequest(clock.unix_us(), Verb.STOP), patience)
    except TimeoutError as error:
        return _fail(f"gcs: no ground answers: {error}", NO_GROUND)
    except (BusError, ConfigError) as error:
        return _fail(f"gcs: {error}", NOT_RIGHT)
    if not reply.accepted:
        return _fail("refused: " + reply.text, REFUSED)
    print(reply.text)
    return 0


def _fail(text: str, code: int) -> int:
    print(text, file=sys.stderr)
    return code
