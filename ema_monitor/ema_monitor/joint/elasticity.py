"""Elasticity of a joint, admitted on healthy records: jerk and snap as terms of the effort."""

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
    """Return the preparation with jerk and snap if they predict the effort, else the one without.

    The effort of a motor that turns a load through a spring depends on jerk and snap. They are
    admitted if they halve the error in every other stroke, to which they were not fitted, in the
    geometric mean over the records. They also filter the noise of a coarse position, and replace a
    lag: this lowers the error by less, and friction gains nothing.

    Parameters
    ----------
    stiff, elastic
        How the records are prepared without and with jerk and snap.
    prepared
        Returns the healthy records by a preparation.
    is_linear
        Whether the joint is linear, so that no gravity follows its angle.
    """
    before, after = (
        held_out_error(prepared(preparation), is_linear=is_linear)
        for preparation in (stiff, elastic)
    )
    return elastic if after < _IMPROVES * before else stiff
