"""Which program has a port: this one, asked of the system."""

import os
import socket

from wire.process.daemon import bus_at
from wire.process.port_holder import listener, port_holder, why_not_bound

US = f" (process {os.getpid()})"


def test_the_program_that_has_a_port_is_named_with_its_process() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken, socket.socket() as other:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        other.bind(("127.0.0.1", 0))
        assert port_holder("udp", port).endswith(US)
        error = OSError(98, "Address already in use")
        assert why_not_bound(error, "udp", port) == f"Address already in use: {port_holder('udp', port)} has it"
        assert port_holder("tcp", other.getsockname()[1]) == ""  # bound, and nobody listens
    assert port_holder("udp", port) == ""
    assert why_not_bound(OSError(99, "Cannot assign"), "udp", port) == "Cannot assign"


def test_a_bus_whose_port_another_program_has_is_not_said_to_lack_a_router() -> None:
    with socket.create_server(("127.0.0.1", 0)) as web:
        here = f"tcp/127.0.0.1:{web.getsockname()[1]}"
        assert listener([here]).endswith(US)
        assert listener([f"tcp/0.0.0.0:{web.getsockname()[1]}", "tcp/192.0.2.1:7447", "unixpipe//tmp/a"]).endswith(US)
        assert "has that port and does not answer as the bus" in bus_at([here], lambda: False, "start it").remedy
    assert bus_at([here], lambda: False, "start it").remedy == "start it"
