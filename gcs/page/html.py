"""The page's words as HTML. Pure; whatever drones, logs and people said is escaped."""

from collections.abc import Sequence
from datetime import datetime
from html import escape

from formation.messages import Severity, Verb
from formation.safety.phases import Trigger, allowed_from
from formation.security_config import MAY_ASK, Role
from gcs.page.show import ABOUT, COLUMNS, LABELS, UNITS, Cell, Level, Show, Step, not_landed_text, worst
from wire.ground_state import Alarm

_MARK = {Level.CALM: "", Level.WARN: "▲ ", Level.BAD: "✖ "}
_CLASS = {Level.CALM: "", Level.WARN: ' class="warn"', Level.BAD: ' class="bad"'}


def head(shown: Show) -> str:
    """Phase, for how long, and why; countdowns beside it."""
    left = "".join(f'<span class="countdown">{escape(text)}</span>' for text in shown.countdowns)
    name = "-" if shown.phase is None else shown.phase.name
    phase = "phase p-aloft" if shown.not_landed else f"phase p-{name.lower()}"
    aloft = f'<span class="aloft">✖ {escape(not_landed_text(shown.not_landed))}</span> ' if shown.not_landed else ""
    return (
        f'<div class="{phase}">{name}</div>'
        f'<div class="cause">{aloft}<b>{escape(shown.since)}</b> {escape(shown.cause)}<br>{left}</div>'
    )


def vital(shown: Show) -> str:
    """The machines in short."""
    return "".join(f"<div><i>{escape(name)}</i>{_span(cell)}</div>" for name, cell in shown.vital)


def table(shown: Show) -> str:
    """One row a drone."""
    heads = "".join(
        f'<th title="{escape(about)}">{name}<small>{unit}</small></th>'
        for name, unit, about in zip(COLUMNS, UNITS, ABOUT, strict=True)
    )
    rows = "".join(
        f'<tr tabindex="0" class="r{int(worst(row))}">' + "".join(map(_cell, row)) + "</tr>" for row in shown.rows
    )
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"


def steps(shown: Show, commands: bool) -> str:
    """For what is not allowed, every reason; what is only out of turn in few words."""
    texts = [_against(step) for step in shown.steps if step.reasons and not step.is_idle]
    turn = [
        f"{LABELS[step.verb]}: only in {', '.join(phase.name for phase in allowed_from(Trigger(step.verb)))}"
        for step in shown.steps
        if step.out_of_turn
    ]
    turn += [
        f"{LABELS[step.verb]}: {escape('; '.join(step.reasons))}"
        for step in shown.steps
        if step.reasons and step.is_idle and not step.out_of_turn
    ]
    later = f'<p class="later">{"<br>".join(turn)}</p>' if turn and commands else ""
    return "".join(texts) + later


def alarms(open_: Sequence[Alarm], latest: Sequence[Alarm]) -> str:
    """Those that are not acknowledged and over; without any, the newest events, dimmed."""
    if open_:
        return "".join(map(_alarm, open_))
    return "".join(f'<p class="event">{_time(one)} {escape(one.source)}: {escape(one.text)}</p>' for one in latest)


def lost(shown: Show) -> str:
    """The words across the whole page; empty while the ground is heard."""
    if not shown.lost:
        return ""
    return f"<h1>NO CONNECTION TO THE GROUND</h1><p>{escape(shown.lost)}</p><p>What is shown is old.</p>"


def _against(step: Step) -> str:
    reasons = "".join(f"<li>{escape(reason)}</li>" for reason in step.reasons)
    return f'<p class="not">{LABELS[step.verb]} is not possible:</p><ul>{reasons}</ul>'


def _alarm(alarm: Alarm) -> str:
    name = "bad" if alarm.severity <= Severity.ERROR else "warn"
    name += " read" if alarm.acknowledged else ""
    mark = "✖" if alarm.severity <= Severity.ERROR else "▲"
    times = f" ({alarm.times} times)" if alarm.times > 1 else ""
    word = alarm.severity.name
    still = (", goes on" if alarm.goes_on else "") + (", acknowledged" if alarm.acknowledged else "")
    return (
        f'<div class="alarm {name}"><b>{mark} {word} {_time(alarm)}</b> '
        f"{escape(alarm.source)}: {escape(alarm.text)}{times}{still}</div>"
    )


def _time(alarm: Alarm) -> str:
    return f"{datetime.fromtimestamp(alarm.unix_s):%H:%M:%S}"


def _cell(cell: Cell) -> str:
    return f"<td{_CLASS[cell.level]}>{_MARK[cell.level]}{escape(cell.text)}</td>"


def _span(cell: Cell) -> str:
    return f"<span{_CLASS[cell.level]}>{_MARK[cell.level]}{escape(cell.text)}</span>"


def plain(text: str) -> str:
    """Words as they are."""
    return escape(text)


def visitor(name: str, role: Role) -> str:
    """Who is logged in, what that role may do, and the way out."""
    may = ", ".join(verb.command_name for verb in Verb if verb in MAY_ASK[role] and verb is not Verb.STATUS)
    may = "everything" if role is Role.OPERATOR else f"only {may}"
    return f'{escape(name)}, {role}: may ask for {may}. <a href="/logout">Log out</a>'


def stopped(shown: Show) -> str:
    """What a stop has done."""
    return escape(shown.stop)


def feasible(text: str, against: str) -> str:
    """What is foreseen of a shape."""
    return f'<span class="bad">✖ {escape(against)}</span>' if against else f"✔ {escape(text)}"
