"""What every configuration model is made of: frozen pydantic, unknown keys refused, and the few types they share."""

import re
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Vec3Tuple = tuple[float, float, float]
QuatTuple = tuple[float, float, float, float]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
LONGEST_NAME = 64


def _name(text: str) -> str:
    if re.fullmatch(r"[A-Za-z0-9_.-]+", text) is None or not text.strip(".") or len(text) > LONGEST_NAME:
        raise ValueError(f"not a name: at most {LONGEST_NAME} letters, digits and . _ -")
    return text


Name = Annotated[str, AfterValidator(_name)]
"""What may stand in a file's name, a key on the bus, a terminal and a page as it is."""
SysId = Annotated[int, Field(ge=1, le=250)]
NO_ROTATION: QuatTuple = (1.0, 0.0, 0.0, 0.0)


class Model(BaseModel):
    """Frozen, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
