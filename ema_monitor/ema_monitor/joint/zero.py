"""Zero of the position: gravity shows by what angle it differs from that of the healthy records."""

import math
from typing import Final, NamedTuple

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.shape import GRAVITY, Shape
from ema_monitor.joint.signals import Signals

_TINY: Final = 1e-300


class ZeroShift(NamedTuple):
    """By how much the position of a record exceeds that of the healthy records.

    Attributes
    ----------
    angle
        Angle by which the healthy gravity is turned in the record, within half a turn [rad].
    gain
        Residual of the effort without the angle, over that with it [-].
    """

    angle: float
    gain: float


def zero_shift(shape: Shape, signals: Signals) -> ZeroShift:
    """Return by how much the position of a record exceeds that of the healthy records.

    The payload is free.

    Parameters
    ----------
    shape
        Model with gravity.
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
    left, without = signals.effort - design @ values, _residual(plain, signals.effort)
    gain = math.sqrt(float(without @ without) / max(float(left @ left), _TINY))
    return ZeroShift(math.atan2(-float(values[-1]), gravity), gain)


def _residual(design: Array, target: Array) -> Array:
    values = np.linalg.lstsq(design, target, rcond=None)[0]
    return np.asarray(target - design @ values, dtype=np.float64)
