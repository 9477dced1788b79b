"""Short names of the types of arrays, of any shape."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Numbers."""

Flags: TypeAlias = NDArray[np.bool_]
"""True or false."""
