"""`gcs stop`, and nothing else: loads the bus alone, since what is loaded is what a stop waits for.

It goes by datagrams and over the bus at once (wire.transport.stop_call); only the command line is read here.
"""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from formation.requests import GCS_NAME, OperatorRequest, Verb
from wire import clock
from wire.errors import BusError, ConfigError
from wire.process.exit_codes import NO_GROUND, NOT_RIGHT, REJECTED
from wire.process.own_name import own_name

Report = Callable[[bool | None, str], None]
_OPTIONS = ("--lab", "--name", "--timeout", "--identity")


def stop(words: Sequence[str]) -> int | None:
    """Stop the swarm by the words after `stop`; the exit code, or None for words that this module does not know.

    `--help` and mistakes are left to the whole command line, which has an answer for each.
    """
    options = dict.fromkeys(_OPTIONS, "")
    report = _print_json if "--json" in words else _print
    rest = [word for word in words if word not in ("--json", "--insecure")]
    while rest:
        name, equals, value = rest.pop(0).partition("=")
        if name not in options or not (equals or rest):
            return None
        options[name] = value if equals else rest.pop(0)
    try:
        timeout_s = float(options["--timeout"]) if options["--timeout"] else None
    except ValueError:
        return None
    return _ask(options, "--insecure" in words, timeout_s, report)


def _ask(options: Mapping[str, str], insecure: bool, timeout_s: float | None, report: Report) -> int:
    from wire.security.bus_access import connectable
    from wire.transport.lab_address import address_near
    from wire.transport.stop_call import ask_to_stop

    name = options["--name"] or GCS_NAME
    try:
        where = address_near(Path(options["--lab"]) if options["--lab"] else None)
        request = OperatorRequest(clock.unix_us(), Verb.STOP, source=own_name())
        access = where.access(options["--identity"], insecure)
        exposed = access.exposed([connectable(endpoint) for endpoint in where.endpoints])
        # Asked all the same: no lack of keys keeps anybody from stopping. Only the answer is not believed.
        access = replace(access, insecure=insecure or exposed is not None)
        reply = ask_to_stop(where.endpoints, where.lab, name, request, timeout_s, access)
    except TimeoutError as error:
        report(None, f"no ground answers: {error}")
        return NO_GROUND
    except (BusError, ConfigError) as error:
        report(None, str(error))
        return NOT_RIGHT
    if exposed is not None:
        report(None, f"a stop was sent, but anybody may have answered it ({reply.text!r}): {exposed}")
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
