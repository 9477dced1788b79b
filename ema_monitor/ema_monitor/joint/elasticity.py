# SPDX-License-Identifier: Apache-2.0
"""Selection of the elastic terms of the effort model, jerk and snap, on healthy records."""

from collections.abc import Callable
from typing import Final

from ema_monitor.joint.heldout import held_out_error
from ema_monitor.joint.signals import Preparation, Signals

_IMPROVES: Final = 0.5


def with_elasticity(
    stiff: Preparation,
    elastic: Preparation,
    prepared: Callable[[Preparation], list[Signals]],
    *,
    is_linear: bool,
) -> Preparation:
    """Return ``elastic`` if jerk and snap improve the prediction of the effort, else ``stiff``.

    The effort of a motor that turns a load through a spring depends on jerk and snap. The terms are
    accepted if they halve the prediction error on held-out strokes (geometric mean over the
    records). Jerk and snap also filter the noise of a coarse position and compensate a lag. These
    side effects reduce the error by less than half, and do not improve the friction estimate.

    Parameters
    ----------
    stiff, elastic
        Preparations without and with jerk and snap.
    prepared
        Function that applies a preparation to the healthy records.
    is_linear
        Whether the joint is linear, so that gravity does not depend on its position.
    """
    before, after = (
        held_out_error(prepared(preparation), is_linear=is_linear)
        for preparation in (stiff, elastic)
    )
    return elastic if after < _IMPROVES * before else stiff
