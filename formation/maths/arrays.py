"""Array types: every array field says its numbers and its shape, so that it can be checked, logged and read back."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Layout:
    """What an array field holds, riding along with its type for the log's schema (wire.schema).

    shape: -1 is the number of vehicles. is_single: the log holds it in single precision.
    """

    scalar: type[np.generic]
    shape: tuple[int, ...]
    is_single: bool = False


Scalars = Annotated[Float, Layout(np.float64, (-1,))]
Vec3s = Annotated[Float, Layout(np.float64, (-1, 3))]
Quats = Annotated[Float, Layout(np.float64, (-1, 4))]
SingleScalars = Annotated[Float, Layout(np.float64, (-1,), is_single=True)]
SingleVec3s = Annotated[Float, Layout(np.float64, (-1, 3), is_single=True)]
SingleQuats = Annotated[Float, Layout(np.float64, (-1, 4), is_single=True)]
Flags = Annotated[Bool, Layout(np.bool_, (-1,))]
Codes = Annotated[NDArray[np.uint8], Layout(np.uint8, (-1,))]
Vec3 = Annotated[Float, Layout(np.float64, (3,))]
Quat = Annotated[Float, Layout(np.float64, (4,))]
SingleVec3 = Annotated[Float, Layout(np.float64, (3,), is_single=True)]
SingleQuat = Annotated[Float, Layout(np.float64, (4,), is_single=True)]
Vec2 = Annotated[Float, Layout(np.float64, (2,))]
Vec4 = Annotated[Float, Layout(np.float64, (4,))]
Mat3 = Annotated[Float, Layout(np.float64, (3, 3))]
Motion = Annotated[Float, Layout(np.float64, (3, 4))]
"""Rows position, velocity, acceleration; columns x, y, z, heading."""
Gap = Annotated[Float, Layout(np.float64, (4, 4))]
"""Rows position, velocity, acceleration, detour; columns x, y, z, heading (formation.guidance.trajectory)."""
