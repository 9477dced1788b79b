# SPDX-License-Identifier: Apache-2.0
"""The pseudo-Huber loss as residuals."""

import numpy as np

from ema_core._jit import kernel
from ema_core.arrays import Array


@kernel(nogil=False)
def pseudo_huber(distance: Array, scale: float) -> Array:
    """Return residuals whose squares are the pseudo-Huber loss of distances.

    The loss is nearly quadratic far below ``scale``, and nearly linear far beyond it.
    """
    ratio = np.square(distance / scale)
    # 2 (sqrt(1 + x) - 1) without the cancellation at small x.
    return distance * np.sqrt(2.0 / (1.0 + np.sqrt(1.0 + ratio)))
