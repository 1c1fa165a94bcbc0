"""Names of those who are on a lab's bus with keys: programs, drones, operators. Without arrays or models."""

GROUND, MOCAP, PAGE, TOOL = "ground", "mocap", "page", "tool"
OWN_IDENTITIES = (GROUND, MOCAP, PAGE, TOOL)
"""The identities that every lab has, beside one for each drone."""


def drone_identity(sysid: int) -> str:
    """The identity of a drone's host."""
    return f"drone-{sysid}"


def numbered(identity: str, number: int) -> str:
    """The name in an identity's certificate: each new certificate has the next number, and the old one is void."""
    return f"{identity}.{number}"


def identity_in(certificate_name: str) -> str:
    """The identity that a name in a certificate belongs to."""
    return certificate_name.rpartition(".")[0]
