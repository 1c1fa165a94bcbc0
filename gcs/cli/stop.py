"""`gcs stop`, and nothing else: loads the bus alone, since what is loaded is what a stop waits for.

Its protocol is that of every other command (wire.transport.zenoh_session.ask); only the command line is read here.
"""

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from formation.requests import GCS_NAME, OperatorRequest, Verb
from wire import clock
from wire.errors import BusError, ConfigError
from wire.process.exit_codes import NO_GROUND, NOT_RIGHT, REJECTED
from wire.process.own_name import own_name

ANSWER_S, DATAGRAM_S = 3.0, 0.4
"""How long an answer is awaited, on the bus, and before that by one datagram, which needs no connection."""
Report = Callable[[bool | None, str], None]
_OPTIONS = ("--lab", "--name", "--timeout", "--identity")


def stop(words: Sequence[str]) -> int | None:
    """Stop the swarm by the words after `stop`; the exit code, or None for words that this module does not know.

    `--help` and mistakes are left to the whole command line, which has an answer for each.
    """
    options = dict.fromkeys(_OPTIONS, "")
    rest = [word for word in words if word != "--json"]
    report = _print_json if len(rest) < len(words) else _print
    while rest:
        name, equals, value = rest.pop(0).partition("=")
        if name not in options or not (equals or rest):
            return None
        options[name] = value if equals else rest.pop(0)
    try:
        timeout_s = float(options["--timeout"]) if options["--timeout"] else None
    except ValueError:
        return None
    return _ask(options["--lab"], options["--name"] or GCS_NAME, timeout_s, report, options["--identity"])


def _ask(lab: str, name: str, timeout_s: float | None, report: Report, identity: str) -> int:
    from wire.transport.lab_address import address_near
    from wire.transport.stop_call import stop_by_datagram

    try:
        where = address_near(Path(lab) if lab else None)
        request = OperatorRequest(clock.unix_us(), Verb.STOP, source=own_name())
        access = where.access(identity)
        reply = stop_by_datagram(where.endpoints, access, request, DATAGRAM_S if name == GCS_NAME else 0.0)
        if reply is None:
            from wire.transport.zenoh_session import Patience, ask

            # Without a time given it is tried for as long as there is anybody on the bus.
            patience = Patience(ANSWER_S, ground_s=ANSWER_S) if timeout_s is None else Patience.throughout(timeout_s)
            reply = ask(where.endpoints, where.lab, name, request, patience, access)
    except TimeoutError as error:
        report(None, f"no ground answers: {error}")
        return NO_GROUND
    except (BusError, ConfigError) as error:
        report(None, str(error))
        return NOT_RIGHT
    report(reply.accepted, reply.text)
    return 0 if reply.accepted else REJECTED


def _print(accepted: bool | None, text: str) -> None:
    """The ground's answer, or why there is none (None), for people."""
    prefix = {True: "", False: "refused: ", None: "gcs: "}[accepted]
    print(prefix + text, file=sys.stdout if accepted else sys.stderr)


def _print_json(accepted: bool | None, text: str) -> None:
    """The same as the other commands print with `--json`."""
    print(json.dumps({"error": text} if accepted is None else {"accepted": accepted, "text": text}))
    if accepted is None:
        _print(accepted, text)
