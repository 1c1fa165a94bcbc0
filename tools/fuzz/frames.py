"""Any frames to the mocap process, and past it to ground, agent and bridge: nothing raises, nobody is locked out.

    python -m tools.fuzz.frames --count 1000000

Frames are bytes of a RawFrame or of a LabFrame: random, or valid ones with any names, numbers and stamps, mutated and
cut. Most go to the edges alone (schema, check, alignment); what those let through is flown by the cores now and then.
After every few frames a sound one must be taken.
"""

import random
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from drone_agent.config import SimulatedDroneConfig
from drone_agent.guard.core import GuardCore
from drone_agent.guarded import GuardedDrone
from formation.config import LabConfig
from formation.maths.arrays import Float
from formation.messages import LabFrame, RawFrame
from gcs.core import GcsCore
from mocap.core import MocapCore
from mocap.judge import RELEARN_FRAMES
from tools.fuzz.command import main
from wire.schema import SchemaError, schema_of
from wire.transport.frame_check import lab_fault

STEP_NS = 1_000_000
PROBE_EVERY = 64
FLOWN_EVERY = 100
LAB = LabConfig.model_validate(
    {"leader": {"body": "lead"}, "followers": [{"body": "left", "sysid": 2, "offset_m": (0.0, 1.0, 0.0)}]}
)
BODIES = tuple(v.body for v in LAB.vehicles)
NAMES = ("lead", "left", "", "wand", "x" * 70, "\x1b[2J", "../../x", "[/]", "ü")
NUMBERS = (0.0, 1.0, -1.0, 0.7071, 999.9, 1001.0, 1e9, 1e200, -1e308, 5e-324, float("nan"), float("inf"), -float("inf"))
STAMPS = (0, 1, -1, 2**62, -(2**62), 2**63 - 1, -(2**63))
RAW, ALIGNED = schema_of(RawFrame), schema_of(LabFrame)


@dataclass(slots=True)
class Result:
    """How it went: what raised or was locked out, in words."""

    count: int = 0
    taken: int = 0
    flown: int = 0
    faults: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        return (
            f"{self.count} frames, {self.taken} taken, {self.flown} flown, {len(self.faults)} exceptions or lock-outs"
        )


class Frames:
    """Draws the bytes of frames."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(seed)
        self._numbers = np.random.default_rng(seed)

    def draw(self, now_ns: int) -> bytes:
        """The next."""
        rng = self._rng
        if rng.random() < 0.1:
            return rng.randbytes(rng.choice((0, 1, 20, 300)))
        data = bytearray(self._valid(now_ns))
        if data and rng.random() < 0.3:
            for _ in range(rng.choice((1, 2, 8))):
                data[rng.randrange(len(data))] = rng.randrange(256)
        return bytes(data[: rng.randrange(len(data) + 1)] if rng.random() < 0.1 else data)

    def _valid(self, now_ns: int) -> bytes:
        rng = self._rng
        n = rng.choice((0, 1, 2, 2, 2, 3, 12))
        bodies = BODIES if n == 2 and rng.random() < 0.7 else tuple(rng.choice(NAMES) for _ in range(n))
        stamp = now_ns - rng.choice((0, 8_000_000, 999_000_000, 2_000_000_000, -19_000_000, -(10**12)))
        stamp = rng.choice(STAMPS) if rng.random() < 0.1 else stamp
        pos, q = self._array(self._rows(n), 3), self._array(self._rows(n), 4)
        if rng.random() < 0.7:
            q = np.tile([1.0, 0.0, 0.0, 0.0], (len(q), 1))
        seen = np.array([rng.random() < 0.9 for _ in range(self._rows(n))], dtype=np.bool_)
        seq = rng.choice((rng.randrange(1000), *STAMPS))
        if rng.random() < 0.6:
            return RAW.encode(RawFrame(seq, stamp, bodies, pos, q, seen))
        return ALIGNED.encode(LabFrame(seq, stamp, bodies, pos, q, seen, rng.choice(STAMPS)))

    def _rows(self, n: int) -> int:
        return n if self._rng.random() < 0.9 else self._rng.choice((0, 1, 2, 40))

    def _array(self, rows: int, columns: int) -> Float:
        if self._rng.random() < 0.6:
            return self._numbers.normal(0.0, 1.0, (rows, columns))
        return self._numbers.choice(NUMBERS, (rows, columns))


class Readers:
    """Everything a frame reaches: both edges, then the cores."""

    def __init__(self, t0_ns: int) -> None:
        self.mocap = MocapCore(LAB)
        self._ground = GcsCore(LAB, t0_ns)
        agent = SimulatedDroneConfig(sysid=2, body="left", pose="mocap")
        self._agent = GuardedDrone(agent, t0_ns)
        self._bridge = GuardCore(agent, t0_ns)

    def read(self, data: bytes, now_ns: int) -> LabFrame | None:
        """As the mocap process and the bus would: the frame that everyone gets, None for one that is refused."""
        message: Any
        for schema in (RAW, ALIGNED):
            try:
                message = schema.decode(data)
            except SchemaError:
                continue
            if isinstance(message, LabFrame):
                if lab_fault(message, now_ns) is None:
                    return message
            elif (frame := self.mocap.receive(message, now_ns)) is not None:
                assert lab_fault(frame, now_ns) is None, lab_fault(frame, now_ns)
                return frame
        return None

    def fly(self, frame: LabFrame, now_ns: int) -> None:
        """As ground, agent and bridge would."""
        self._ground.receive(frame, now_ns)
        self._ground.tick(now_ns)
        self._ground.state(now_ns)
        self._agent.receive(frame, now_ns)
        self._agent.tick(now_ns)
        self._bridge.receive_frame(frame, now_ns)
        self._bridge.tick(now_ns)

    def takes(self, now_ns: int) -> bool:
        """Whether sound frames are taken at once, and soon believed, whatever came before them."""
        frame = None
        for k in range(RELEARN_FRAMES + 1):
            t_ns = now_ns + k * STEP_NS
            frame = self.read(RAW.encode(_sound(k, t_ns)), t_ns)
            if frame is None:
                return False
            if frame.seen.all():
                self.fly(replace(frame), t_ns)
                return True
        return False


def _sound(k: int, t_ns: int) -> RawFrame:
    """Two bodies at rest, seen by cameras that have some noise."""
    pos = np.full((2, 3), 1e-5 * (k % 7))
    return RawFrame(1, t_ns, BODIES, pos, np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)), np.ones(2, np.bool_))


def fuzz(count: int, seed: int) -> Result:
    """Draw and read `count` frames."""
    result, now_ns = Result(), 10**12
    frames, readers = Frames(seed), Readers(now_ns)
    for k in range(count):
        now_ns += STEP_NS
        data = frames.draw(now_ns)
        try:
            frame = readers.read(data, now_ns)
            if frame is not None:
                result.taken += 1
                if result.taken % FLOWN_EVERY == 0:
                    result.flown += 1
                    readers.fly(frame, now_ns)
            if k % PROBE_EVERY == 0:
                now_ns += 25 * STEP_NS  # a stamp may be ahead by 20 ms: so long may it keep others out
                if not readers.takes(now_ns):
                    result.faults.append(f"frame {k}: sound frames were not taken after {data[:40].hex()}")
                now_ns += (RELEARN_FRAMES + 1) * STEP_NS
        except Exception as error:  # noqa: BLE001 - to find any is what this is for
            result.faults.append(f"frame {k}: {type(error).__name__}: {error}: {data[:60].hex()}")
        result.count += 1
    return result


if __name__ == "__main__":
    main(fuzz, __doc__)
