"""The table `[security]`: where the lab's keys are, and who may ask the ground for what. Pure."""

from enum import StrEnum
from ipaddress import ip_address
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from formation.exposure import OWN_IDENTITIES, PAGE, TOOL
from formation.model import Model, Name, WrongKeyError
from formation.requests import Verb


class Role(StrEnum):
    """What an operator may ask the ground for."""

    VIEWER = "viewer"
    """Sees everything, and may stop."""
    SAFETY = "safety"
    """May also hold, land and acknowledge."""
    OPERATOR = "operator"
    """May ask for everything."""


_SAFETY = frozenset({Verb.STATUS, Verb.STOP, Verb.HOLD, Verb.LAND, Verb.ACKNOWLEDGE})
MAY_ASK: dict[Role, frozenset[Verb]] = {
    Role.VIEWER: frozenset({Verb.STATUS, Verb.STOP}),
    Role.SAFETY: _SAFETY,
    Role.OPERATOR: frozenset(Verb),
}
"""The requests of each role; everybody may stop."""


def _address(text: str) -> str:
    try:
        return str(ip_address(text))
    except ValueError:
        raise ValueError("not an IP address") from None


class SecurityConfig(Model):
    """Keys and roles; with this table every link of the lab is authenticated."""

    keys: Annotated[str, Field(min_length=1, max_length=255)] = "keys"
    """Folder of the keys, as `gcs keys new` makes it; a relative path counts from the lab file."""
    addresses: tuple[Annotated[str, AfterValidator(_address)], ...] = ()
    """Addresses of the ground computer by which drones reach it; needed where it listens at 0.0.0.0."""
    operators: dict[Name, Role] = Field(default_factory=dict)
    """Operators with keys of their own, by name, and their role: `viewer`, `safety` or `operator`."""
    page: Role = Role.OPERATOR
    """Role of the operator's page."""

    @model_validator(mode="after")
    def _names_are_free(self) -> Self:
        for name in self.operators:
            if name in OWN_IDENTITIES or name.startswith("drone-"):
                raise WrongKeyError(f"operators.{name}", "this name is that of a program or drone: choose another")
        return self

    def role_of(self, identity: str) -> Role | None:
        """The role of an identity on the bus; None where it may ask for nothing."""
        if identity == TOOL:
            return Role.OPERATOR
        return self.page if identity == PAGE else self.operators.get(identity)
