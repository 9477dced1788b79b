# SPDX-License-Identifier: Apache-2.0
"""Type aliases for arrays of any shape."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Array of floats."""

Flags: TypeAlias = NDArray[np.bool_]
"""Array of booleans."""
