"""Array types: every array field says its shape, so that it can be checked, logged and read back."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

# -1 is the number of vehicles; the shape rides along for the log's schema (wire.schema).
Scalars = Annotated[Float, (-1,)]
Vec3s = Annotated[Float, (-1, 3)]
Quats = Annotated[Float, (-1, 4)]
Flags = Annotated[Bool, (-1,)]
Vec3 = Annotated[Float, (3,)]
Quat = Annotated[Float, (4,)]
