"""What every configuration model is made of: frozen pydantic, unknown keys refused, and the few types they share."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Vec3Tuple = tuple[float, float, float]
QuatTuple = tuple[float, float, float, float]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
SysId = Annotated[int, Field(ge=1, le=250)]
NO_ROTATION: QuatTuple = (1.0, 0.0, 0.0, 0.0)


class Model(BaseModel):
    """Frozen, no unknown keys, no NaN."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
