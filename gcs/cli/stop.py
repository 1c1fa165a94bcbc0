"""`gcs stop`, and nothing else: loads the bus alone, since what is loaded is what a stop waits for.

It goes by datagrams and over the bus at once (wire.transport.stop_call); only the command line is read here.
"""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from formation.requests import GCS_NAME, OperatorRequest, Verb
from wire import clock
from wire.errors import BusError, ConfigError
from wire.process.system import NO_GROUND, NOT_RIGHT, REJECTED, own_name, prefer_process

if TYPE_CHECKING:
    from wire.transport.lab_address import LabAddress

Report = Callable[[bool | None, str, Sequence[str]], None]
_OPTIONS = ("--lab", "--name", "--timeout", "--identity")


def stop(words: Sequence[str]) -> int | None:
    """Stop the swarm by the words after `stop`; the exit code, or None for words that this module does not know.

    `--help` and mistakes are left to the whole command line, which has an answer for each.
    """
    prefer_process()  # before all that a busy computer does beside it
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
    return _stop(options, "--insecure" in words, timeout_s, report)


def _stop(options: Mapping[str, str], insecure: bool, timeout_s: float | None, report: Report) -> int:
    from wire.transport.lab_address import LabAddress, address_near

    try:
        wheres = [address_near(Path(options["--lab"]) if options["--lab"] else None)]
        if not options["--lab"] and wheres[0] != LabAddress():
            wheres.append(LabAddress())  # the ground that flies may be another lab's than the file's here
        for where in wheres:
            code, accepted, text, codes = _ask(where, options, insecure, timeout_s)
            if code != NO_GROUND:
                break
    except (BusError, ConfigError) as error:
        code, accepted, text, codes = NOT_RIGHT, None, str(error), ()
    report(accepted, text, codes)
    return code


def _ask(
    where: "LabAddress", options: Mapping[str, str], insecure: bool, timeout_s: float | None
) -> tuple[int, bool | None, str, tuple[str, ...]]:
    """The exit code, and the ground's answer: whether it stops, None for no answer that counts, its text and codes."""
    from wire.security.bus_access import connectable
    from wire.transport.stop_call import ask_to_stop

    name = options["--name"] or GCS_NAME
    request = OperatorRequest(clock.unix_us(), Verb.STOP, source=own_name())
    access = where.access(options["--identity"], insecure)
    exposed = access.exposed([connectable(endpoint) for endpoint in where.endpoints])
    # Asked all the same: no lack of keys keeps anybody from stopping. Only the answer is not believed.
    access = replace(access, insecure=insecure or exposed is not None)
    try:
        reply = ask_to_stop(where.endpoints, where.lab, name, request, timeout_s, access)
    except TimeoutError as error:
        return NO_GROUND, None, f"no ground answers: {error}", ()
    if exposed is not None:
        text = f"a stop was sent, but anybody may have answered it ({reply.text!r}): {exposed}"
        return NOT_RIGHT, None, text, ()
    return 0 if reply.accepted else REJECTED, reply.accepted, reply.text, reply.codes


def _print(accepted: bool | None, text: str, _codes: Sequence[str]) -> None:
    """The ground's answer, or why there is none (None), for people."""
    prefix = {True: "", False: "refused: ", None: "gcs: "}[accepted]
    print(prefix + text, file=sys.stdout if accepted else sys.stderr)


def _print_json(accepted: bool | None, text: str, codes: Sequence[str]) -> None:
    """The same as the other commands print with `--json`."""
    print(json.dumps({"error": text} if accepted is None else {"accepted": accepted, "text": text, "codes": codes}))
    if accepted is None:
        _print(accepted, text, codes)
