"""Copies in kernels: an assignment to a slice brings along numba's words for what does not fit, 3 s to compile."""

from typing import Any

from numpy.typing import NDArray

from formation.maths.kernel import kernel


@kernel
def copy_into(values: NDArray[Any], out: NDArray[Any]) -> None:
    """Copy values (k) into out (k)."""
    for k in range(len(out)):
        out[k] = values[k]
