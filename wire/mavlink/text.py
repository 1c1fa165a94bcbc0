"""STATUSTEXT: fifty bytes a packet, longer texts in numbered chunks, cut here and joined again."""

from dataclasses import dataclass

from formation.messages import Severity
from wire.link_messages import Address, StatusText
from wire.mavlink.framing import Fields, layout
from wire.text import plain

STATUSTEXT = layout("STATUSTEXT", 4)
_CHUNK = 50
_LONGEST = 255 * _CHUNK  # chunk_seq is one byte
_SOURCES = 64
LONGEST_READ = 400
"""Characters of a text read, and about as many bytes held of one that does not end; autopilots say less than 130."""
_CHUNKS_HELD = LONGEST_READ // _CHUNK + 1


@dataclass(frozen=True, slots=True)
class TextChunk:
    """One packet's part of a text; `id` is zero for a text of one packet, `last` ends the text."""

    severity: Severity
    id: int
    index: int
    part: bytes
    last: bool


def chunk_text(message: StatusText, text_id: int) -> list[Fields]:
    """The packets' fields; a text whose chunks are all full is ended by an empty one, as MAVLink asks."""
    data = message.text.encode(errors="replace")[:_LONGEST]
    severity = int(message.severity)
    if len(data) <= _CHUNK:
        return [(severity, data, 0, 0)]
    parts = [data[at : at + _CHUNK] for at in range(0, len(data), _CHUNK)]
    if len(parts[-1]) == _CHUNK:
        parts.append(b"")
    return [(severity, part, text_id, index) for index, part in enumerate(parts)]


def read_chunk(fields: Fields) -> TextChunk:
    """The chunk in one packet's fields."""
    severity, text, text_id, index = fields
    part, null, _ = text.partition(b"\0")
    return TextChunk(Severity(severity), text_id, index, part, last=bool(null) or text_id == 0)


def text_of(severity: Severity, parts: list[bytes]) -> StatusText:
    """The text of joined parts, fit to be printed; bytes that are not UTF-8 show as the replacement character."""
    return StatusText(severity, plain(b"".join(parts).decode(errors="replace"), LONGEST_READ))


class TextJoiner:
    """Joins the chunks of each sender; a missing chunk or a new text ends the old one with an ellipsis."""

    def __init__(self) -> None:
        self._open: dict[Address, list[TextChunk]] = {}

    def join(self, source: Address, chunk: TextChunk) -> list[StatusText]:
        """The texts that this chunk completes: none, one, or the broken one before it and this one."""
        if chunk.last and chunk.index == 0 and source not in self._open:
            return [text_of(chunk.severity, [chunk.part])]
        texts: list[StatusText] = []
        held = self._open.pop(source, [])
        if held and (chunk.id != held[0].id or chunk.index != held[-1].index + 1):
            texts.append(_broken(held))
            held = []
        if len(held) == _CHUNKS_HELD:
            held[-1] = chunk  # too long to be read anyway: what goes on is not kept
        else:
            held.append(chunk)
        if chunk.last:
            texts.append(_whole(held))
        else:
            if len(self._open) >= _SOURCES:
                texts.append(_broken(self._open.pop(next(iter(self._open)))))
            self._open[source] = held
        return texts


_ELLIPSIS = "…".encode()


def _broken(held: list[TextChunk]) -> StatusText:
    return text_of(held[0].severity, [*_lead(held), *(c.part for c in held), _ELLIPSIS])


def _whole(held: list[TextChunk]) -> StatusText:
    return text_of(held[0].severity, [*_lead(held), *(c.part for c in held)])


def _lead(held: list[TextChunk]) -> list[bytes]:
    return [_ELLIPSIS] if held[0].index > 0 else []
