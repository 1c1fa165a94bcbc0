"""What a program runs on, in words; for logs."""

import os
import platform

import numpy as np


def machine() -> str:
    """Host name, system, processors, Python and numpy."""
    return (
        f"{platform.node()}, {platform.system()} {platform.release()} {platform.machine()}, "
        f"{os.cpu_count()} processors, Python {platform.python_version()}, numpy {np.__version__}"
    )
