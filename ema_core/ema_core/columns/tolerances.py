# SPDX-License-Identifier: Apache-2.0
"""Tolerances of relations between columns, by the data that show the relation.

A tolerance below 1 is the largest difference of a ratio from 1, see `is_within`. A tolerance above
1 is the largest factor by which a ratio is above or below 1, see `is_beyond`.
"""

from typing import Final

NEAR: Final = 0.1
"""Relative tolerance for matching a factor to a mistake [-]. Sensors and faults change a relation
between columns by a few per cent, and the factors of most mistakes differ by more than twice this
tolerance."""

NEAR_MODEL: Final = 0.4
"""Tolerance for matching a factor relative to the modelled response of the described actuator [-].
Healthy windows of random units deviate by at most 8 %; deviations that are not yet fitted may be
several times larger."""

# An imported recording of a modelled drive.
MAPPED_SPEED: Final = 0.03
"""Derivative of the position over speed times gear ratio [-], measured in fast motion or over whole
strokes, where the gear stays on one flank."""
MAPPED_TRACKING: Final = 0.35
"""Travel of the position over travel of the command [-]."""
OVER_STOP: Final = 1.05
"""Largest position over the end stop [-]."""
OVER_TOP_SPEED: Final = 3.0
"""Largest speed over the top speed [-]."""
WRONG_TRACKING: Final = 2.0
"""Travel of the position over travel of the command, beyond which the columns cannot be used [-].
A closer ratio that no unit, sign or shaft explains may result from lag or a limit."""

# An imported recording of an unknown drive, which may have an elastic gear or a lagging sensor.
PLAUSIBLE: Final = 2.0
"""Ratio of two columns without a mistake [-]."""
NEAR_MISTAKE: Final = 1.2
"""Ratio of two columns after the correction of one mistake [-]."""
NEAR_MISTAKES: Final = 1.05
"""Ratio of two columns after the correction of several mistakes [-]. Products of two factors match
more ratios by chance."""
NOTED_TRACKING: Final = 1.35
"""Travel of the position over travel of the command, beyond which a note is given [-]. The note
prevents no estimate, so the tolerance is narrower below 1 than `MAPPED_TRACKING`."""

# The current of an imported recording.
CORRELATED: Final = 0.4
"""Correlation of the current with acceleration and friction that shows its sign [-]."""
GAINS_ENERGY: Final = 0.1
"""Share of net work in all work that shows a wrong sign of the current [-]."""
NEAR_THOUSANDTHS: Final = 8.0
"""Size of the current over the required size, after the correction of thousandths [-]."""
CURRENT_SIZE: Final = 30.0
"""Size of the current over the size that inertia and friction require [-]."""

# A window of a unit that may be faulty.
WINDOW_FACTOR: Final = 1.25
"""Speed over the derivative of the position, and apparent over calibrated inertia [-]."""
WINDOW_TRACKING: Final = 1.6
"""Position over command [-]; the position lags, and faults change the lag."""
WINDOW_INERTIA: Final = 0.3
"""Apparent over calibrated inertia after the correction of the speed [-]."""
AMPLITUDE: Final = 0.02
"""Fitted gain of the current over the factor between peak and RMS [-]."""

# A healthy window and the response of the described actuator.
RELATED: Final = 0.5
"""Correlation below which a column is unrelated to the response [-]."""

# A record and the healthy records of its unit.
RECORD_SPEED: Final = 5.0
"""Ratio of usual speeds; other motions of the same joint may be several times faster [-]."""
RECORD_EFFORT: Final = 5.0
"""Ratio of friction and inertia to their healthy values [-]. Friction alone may grow several-fold.
If the inertia grows as well, the effort has a different unit or comes from a different sensor."""
RECORD_EFFORT_BY_FRICTION: Final = 20.0
"""Ratio of friction to healthy if the inertia is unknown [-]."""
RECORD_UPDATES: Final = 1.15
"""Ratio of samples per update beyond which roughness and scatter are not compared [-]."""


def is_within(ratio: float, tolerance: float) -> bool:
    """Return whether a ratio differs from 1 by a tolerance at most."""
    return abs(ratio - 1.0) <= tolerance


def is_beyond(ratio: float, factor: float) -> bool:
    """Return whether a ratio is outside 1 / factor to factor; negative ratios are outside."""
    return not 1.0 / factor < ratio < factor
