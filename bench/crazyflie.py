"""The world of a Crazyflie whose firmware runs in the loop: our body at 1 kHz by its motors' commands, its inertial
sensors, its client's packets passed on both ways. `python -m bench.crazyflie --help`.

The firmware is llanesc/crazyflie-firmware's build for software in the loop, started as `cf2 PORT 127.0.0.1`. It sends
0xF3 to that port until it is answered by the same; sensors and motors are packets of CRTP port 9, beside the client's.
What goes wrong is asked for by UDP: {"lose_s": 1.0} loses the client's packets, {"flip": true} turns it over.
"""

import json
import socket
import struct
from select import select
from typing import Annotated

import numpy as np
import typer

from formation.maths.arrays import Float
from formation.maths.frames import inverse, rotate
from formation.vehicle import body
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import CRAZYFLIE_27G, at_rest
from formation.vehicle.rigid_body import body_step
from wire.clock import REAL_TIME

STEP_NS = 1_000_000
TRUTH_STEPS = 4
HELLO = b"\xf3"
ACC_G, GYRO_DEG_S = 32.0 / 65536.0, 4000.0 / 65536.0
"""Of a bit of the sensors (sensors_sitl.c)."""
ACC_NOISE_G, GYRO_NOISE_DEG_S = 0.02, 0.1
LATE_NS = 20_000_000
"""A world that is later than this lets time go by without it."""


class World:
    """One vehicle, level at rest on the floor at the origin."""

    def __init__(self, seed: int) -> None:
        self.x: Float = at_rest(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])).x
        self._numbers = CRAZYFLIE_27G.numbers.copy()
        self._numbers[body.YAW_TORQUE] *= -1.0  # its front right propeller turns the other way
        self._targets_n, self._push, self._work = np.zeros(4), np.zeros(3), np.empty((5, 3))
        self.turns = False
        self._rng = np.random.default_rng(seed)

    def receive_motors(self, front_right: int, rear_right: int, rear_left: int, front_left: int) -> None:
        """Commands 0..65535."""
        pwm = front_right, rear_left, front_left, rear_right
        u = np.array(pwm) / 65535.0
        k = CRAZYFLIE_27G.thrust_curve
        if (max(pwm) > 0) != self.turns:
            self.turns = max(pwm) > 0
            print(f"{REAL_TIME.monotonic_ns() * 1e-9:.4f} motors {'on' if self.turns else 'off'}", flush=True)
        self._targets_n = 0.25 * CRAZYFLIE_27G.thrust_max_n * ((1.0 - k) * u + k * u * u)

    def step(self) -> bytes:
        """One step; returns the packet of its accelerometer and gyroscope."""
        before = self.x[3:6].copy()
        body_step(self.x, self._targets_n, self._numbers, self._push, STEP_NS * 1e-9, self._work)
        force = (self.x[3:6] - before) / (STEP_NS * 1e-9) + np.array([0.0, 0.0, GRAVITY_M_S2])
        acc_g = rotate(inverse(self.x[6:10]), force) / GRAVITY_M_S2 + self._rng.normal(0.0, ACC_NOISE_G, 3)
        gyro_deg_s = np.degrees(self.x[10:13]) + self._rng.normal(0.0, GYRO_NOISE_DEG_S, 3)
        values = np.clip(np.concatenate([acc_g / ACC_G, gyro_deg_s / GYRO_DEG_S]), -32768, 32767)
        return struct.pack("<BB6h", 0x90, 0, *np.rint(values).astype(int).tolist())

    def flip(self) -> None:
        """Turn it over where it is."""
        self.x[6:10] = 0.0, 1.0, 0.0, 0.0

    def truth(self, t_s: float, late_s: float) -> bytes:
        """Twelve doubles: time, position, attitude and velocity in NED and FRD, how late the world is."""
        p, v, (w, x, y, z) = self.x[0:3], self.x[3:6], self.x[6:10].tolist()
        return struct.pack("<12d", t_s, p[0], -p[1], -p[2], w, x, -y, -z, v[0], -v[1], -v[2], late_s)


def _listening(port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", port))
    opened.setblocking(False)
    return opened


def _received(end: socket.socket) -> list[tuple[bytes, tuple[str, int]]]:
    packets = []
    while True:
        try:
            packets.append(end.recvfrom(64))
        except BlockingIOError:
            return packets
        except ConnectionRefusedError:
            continue


def main(
    firmware: Annotated[int, typer.Option(help="Port that the firmware was given.")] = 19950,
    client: Annotated[int, typer.Option(help="Port for udp://127.0.0.1:PORT of its client.")] = 19850,
    control: Annotated[int, typer.Option(help="Port for what goes wrong.")] = 19750,
    truth: Annotated[list[int] | None, typer.Option(help="Port to send the true state to.")] = None,
    seed: Annotated[int, typer.Option(help="Of the sensors' noise.")] = 1,
) -> None:
    """Be the world until interrupted."""
    world, clock = World(seed), REAL_TIME
    ends = [_listening(port) for port in (firmware, client, control)]
    vehicle: tuple[str, int] | None = None
    user: tuple[str, int] | None = None
    t_ns = clock.monotonic_ns()
    lost_until_ns, steps, longest_ns = 0, 0, 0
    while True:
        for data, sender in _received(ends[0]):
            if data == HELLO:
                vehicle = sender
                ends[0].sendto(HELLO, sender)
            elif data[0] >> 4 == 9 and len(data) == 9:
                world.receive_motors(*struct.unpack("<4H", data[1:]))
            elif user is not None and t_ns >= lost_until_ns:
                ends[1].sendto(data, user)
        for data, sender in _received(ends[1]):
            user = sender
            if vehicle is not None and t_ns >= lost_until_ns:
                ends[0].sendto(data, vehicle)
        for data, _ in _received(ends[2]):
            order = json.loads(data)
            lost_until_ns = t_ns + round(order.get("lose_s", 0.0) * 1e9)
            if order.get("flip"):
                world.flip()
        late_ns = clock.monotonic_ns() - t_ns
        longest_ns = max(longest_ns, late_ns)
        if late_ns > LATE_NS:
            t_ns += late_ns
        if late_ns < STEP_NS:
            select(ends, [], [], clock.seconds_until(t_ns + STEP_NS))
            if clock.monotonic_ns() < t_ns + STEP_NS:
                continue
        t_ns += STEP_NS
        sensors = world.step()
        if vehicle is not None:
            ends[0].sendto(sensors, vehicle)
        steps += 1
        if steps % TRUTH_STEPS == 0:
            for port in truth or ():
                ends[2].sendto(world.truth(t_ns * 1e-9, longest_ns * 1e-9), ("127.0.0.1", port))
            longest_ns = 0


if __name__ == "__main__":
    typer.run(main)
