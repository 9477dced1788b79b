# SPDX-License-Identifier: Apache-2.0
"""Detection of a shifted position zero from the gravity torque."""

import math
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.shape import GRAVITY, Shape
from ema_monitor.joint.signals import Signals

_TINY: Final = 1e-300


class ZeroShift(NamedTuple):
    """Position offset of a record relative to the healthy records."""

    angle: float
    """Angle by which the position exceeds the healthy position, within half a turn [rad]."""
    gain: float
    """Ratio of the effort residuals without and with the shift [-]."""


def zero_shift(shape: Shape, signals: Signals) -> ZeroShift:
    """Return the position offset of a record, estimated together with its payload.

    Parameters
    ----------
    shape
        Effort model of the unit, with gravity.
    signals
        Rows of the record.
    """
    angle = signals.position - shape.centre
    turned = shape.sine * np.cos(angle) - shape.cosine * np.sin(angle)
    used = np.flatnonzero(shape.used)
    plain = np.column_stack([shape.design(signals)[:, used], signals.free])
    design = np.column_stack([plain, turned])
    values = np.linalg.lstsq(design, signals.effort, rcond=None)[0]
    gravity = float(values[np.flatnonzero(used == GRAVITY)[0]])
    shifted, unshifted = signals.effort - design @ values, _residual(plain, signals.effort)
    gain = math.sqrt(float(unshifted @ unshifted) / max(float(shifted @ shifted), _TINY))
    return ZeroShift(math.atan2(-float(values[-1]), gravity), gain)


def _residual(design: Array, target: Array) -> Array:
    values = np.linalg.lstsq(design, target, rcond=None)[0]
    return np.asarray(target - design @ values, dtype=np.float64)
