"""A Crazyflie's end of CRTP, as the firmware in the loop answers: tables, parameters, log blocks, supervisor."""

from struct import pack, unpack

from wire.crtp import BLOCKS, Supervisor

PARAMETERS: dict[str, tuple[int, str, float]] = {
    "flightmode.stabModeYaw": (0x08, "B", 0),
    "stabilizer.estimator": (0x08, "B", 2),
    "locSrv.extPosStdDev": (0x06, "f", 0.25),
}
TYPES = {1: "B", 2: "H", 4: "b", 5: "h", 8: "e"}
AT_REST = {"stateEstimate.qw": 1.0, "acc.z": 1.0, "pm.vbat": 4.1}


class Peer:
    """Give it packets; `answers` are its own."""

    def __init__(self, *lacks: str) -> None:
        self.variables = {n: kind for _, block in BLOCKS for n, kind in block.items() if n not in lacks}
        self.parameters = {n: value for n, value in PARAMETERS.items() if n not in lacks}
        self.values = dict.fromkeys(self.variables, 0.0) | {n: v for n, v in AT_REST.items() if n in self.variables}
        self.info = Supervisor.CAN_BE_ARMED
        self.blocks: dict[int, list[int]] = {}
        self.started: dict[int, int] = {}
        self.setpoints: list[tuple[float, float, float, int]] = []
        self.poses: list[tuple[float, ...]] = []
        self.stops = self.motors_off = 0

    def receive(self, data: bytes) -> list[bytes]:
        """The replies to a packet."""
        port, channel, body = data[0] >> 4, data[0] & 3, data[1:]
        if (port, channel) == (13, 1):
            return [data[:2] + bytes((7, 0, 0, 0))]
        if (port, channel) == (13, 0):
            self.info = (Supervisor.IS_ARMED | Supervisor.CAN_FLY) if body[1] else Supervisor.CAN_BE_ARMED
        elif channel == 0 and port in (2, 5):
            return [data[:1] + self._contents(list(self.variables if port == 5 else self.parameters), port, body)]
        elif port == 5:
            if body[0] == 6:
                self.blocks[body[1]] = [unpack("<H", body[i + 1 : i + 3])[0] for i in range(2, len(body), 3)]
            elif body[0] == 3:
                self.started[body[1]] = body[2] * 10
            return [data[:1] + bytes((body[0], body[1] if len(body) > 1 else 0, 0))]
        elif port == 2:
            name = list(self.parameters)[unpack("<H", body[:2])[0]]
            kind, code, value = self.parameters[name]
            if channel == 2:
                self.parameters[name] = kind, code, unpack("<" + code, body[2:])[0]
                return [data]
            return [data[:3] + b"\x00" + pack("<" + code, value)]
        elif port == 3:
            self.setpoints.append(unpack("<fffH", body))
        elif port == 6 and body[0] == 8:
            self.poses.append(unpack("<7f", body[1:]))
        elif port == 6 and body[0] == 3:
            self.stops += 1
        elif port == 7:
            self.motors_off += 1
        return []

    def logged(self, t_ms: int) -> list[bytes]:
        """The packets that are due at that time of its own."""
        self.values["supervisor.info"] = float(self.info)
        names = list(self.variables)
        packets = []
        for block, period_ms in self.started.items():
            if t_ms % period_ms == 0:
                data = bytes((0x5E, block)) + t_ms.to_bytes(3, "little")
                for number in self.blocks[block]:
                    code, value = TYPES[self.variables[names[number]]], self.values[names[number]]
                    data += pack("<" + code, value if code == "e" else round(value))
                packets.append(data)
        return packets

    def _contents(self, names: list[str], port: int, body: bytes) -> bytes:
        if body[0] == 3:
            return pack("<BHI", 3, len(names), 0xC0FFEE)
        number = unpack("<H", body[1:3])[0]
        kind = self.variables[names[number]] if port == 5 else self.parameters[names[number]][0]
        return body[:3] + bytes((kind,)) + b"\x00".join(part.encode() for part in names[number].split(".")) + b"\x00"
