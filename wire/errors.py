"""What a person has got wrong, in one line a fault."""


class ConfigError(ValueError):
    """A configuration that cannot be used; `problems` has one line a fault, `str` is all of them."""

    def __init__(self, problems: list[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


class BusError(OSError):
    """The bus could not be opened: an endpoint that is taken or not an endpoint, a name that cannot be a key."""
