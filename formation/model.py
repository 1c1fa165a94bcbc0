"""What every configuration model is made of: frozen pydantic, unknown keys refused, and the few types they share."""

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

LARGEST, SMALLEST = 1e6, 1e-9
"""No length, time, angle or mass of a lab is larger, and none that has to be there is smaller."""


class WrongKeyError(ValueError):
    """A rule of a whole table, and which of its keys breaks it: `key`, from the table on; value: as the file has it."""

    def __init__(self, key: str, text: str, value: object = None) -> None:
        super().__init__(text)
        self.key, self.value = key, value


def _no_flag(value: object) -> object:
    """`true` is no number, though Python takes it for 1, nor is "1", though pydantic does."""
    if isinstance(value, bool | str):
        raise ValueError("a number is wanted" + (", without quotes" if isinstance(value, str) else ""))
    return value


def _not_tiny(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"too small: {SMALLEST:g} at least")
    return value


NoFlag = BeforeValidator(_no_flag)
Flag = Annotated[bool, Field(strict=True)]
"""True or false, and neither "no" nor 0."""
Number = Annotated[float, NoFlag, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, NoFlag, Field(gt=0.0, le=LARGEST), AfterValidator(_not_tiny)]
Vec3Tuple = tuple[Number, Number, Number]
QuatTuple = tuple[Number, Number, Number, Number]
LONGEST_NAME = 64


def _name(text: str) -> str:
    if re.fullmatch(r"[A-Za-z0-9_.-]+", text) is None or not text.strip(".") or len(text) > LONGEST_NAME:
        raise ValueError(f"not a name: at most {LONGEST_NAME} letters, digits and . _ -")
    return text


Name = Annotated[str, AfterValidator(_name)]
"""What may stand in a file's name, a key on the bus, a terminal and a page as it is."""
SysId = Annotated[int, NoFlag, Field(ge=1, le=250)]
NO_ROTATION: QuatTuple = (1.0, 0.0, 0.0, 0.0)


class Model(BaseModel):
    """Frozen, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
