"""Which links of a lab other machines reach: each needs `[security]`. By the file alone."""

from collections.abc import Iterator

from formation.config import LabConfig
from formation.exposure import endpoint_host, is_local_endpoint, is_local_link, is_loopback
from gcs.finding import Finding
from gcs.lab.keys import Keys
from wire.security.bus_access import REMEDY

SECURITY = "security"
EXPOSED = "not on this machine, and nothing authenticates it"


def judge_exposure(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Reject links of other machines without keys, and with keys what cannot carry them."""
    if config.security is None:
        for key in exposed_keys(config):
            yield keys.reject(key, SECURITY, f"{EXPOSED}: {REMEDY}")
        return
    for name in ("zenoh_listen", "zenoh_connect"):
        for k, endpoint in enumerate(getattr(config.link, name)):
            if endpoint.partition("/")[0] not in ("tcp", "tls"):
                yield keys.reject(
                    f"link.{name}[{k}]", SECURITY, "with [security] the bus is TLS alone", "tls/HOST:PORT"
                )
            elif endpoint_host(endpoint) in ("0.0.0.0", "::") and not config.security.addresses:
                why = "other machines check the ground's address, and this is any: say which it has"
                yield keys.reject(f"link.{name}[{k}]", SECURITY, why, "security.addresses = [...]")


def exposed_keys(config: LabConfig) -> Iterator[str]:
    """The key of each endpoint of bus and MAVLink that is not on this machine; camera systems are not among them."""
    link = config.link
    for name, endpoints in (("zenoh_listen", link.zenoh_listen), ("zenoh_connect", link.zenoh_connect)):
        for k, endpoint in enumerate(endpoints):
            if not is_local_endpoint(endpoint):
                yield f"link.{name}[{k}]"
    if link.kind == "udp" and not is_loopback(link.host):
        yield "link.host"
    for i, vehicle in enumerate(config.vehicles):
        if vehicle.sysid is not None and vehicle.link is not None and not is_local_link(vehicle.link):
            yield f"{config.key_of(i)}.link"
