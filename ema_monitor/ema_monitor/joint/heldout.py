# SPDX-License-Identifier: Apache-2.0
"""Cross-validation of effort models: the prediction error on held-out strokes."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.signals import Signals

IMPROVES: Final = 0.95
"""Largest ratio of the errors with and without a term at which the term is accepted [-]."""

_TINY: Final = 1e-12


def general_design(signals: Signals, *, is_linear: bool) -> Array:
    """Return the design matrix of a general effort model for a single record, ``(n, p)``.

    Parameters
    ----------
    signals
        Rows of the record.
    is_linear
        Whether the joint is linear, so that gravity does not depend on its position.
    """
    gravity = [] if is_linear else [np.sin(signals.position), np.cos(signals.position)]
    columns = [signals.direction, signals.acceleration, signals.speed, np.ones(len(signals))]
    return np.column_stack([*columns, *gravity, signals.stribeck[:, 1], signals.free])


def halves(signals: Signals) -> tuple[Signals, Signals]:
    """Return the even strokes and the odd strokes of a record; each half has both directions."""
    chosen = signals.every_other_stroke()
    return signals.at(chosen), signals.at(~chosen)


def held_out_error(records: Sequence[Signals], *, is_linear: bool) -> float:
    """Return the prediction error on every other stroke after a fit to the remaining strokes [A].

    The error is the geometric mean over the records. It is infinite if all records are too short.
    """
    logs = []
    for record in records:
        fitted, rest = halves(record)
        design = general_design(fitted, is_linear=is_linear)
        if min(len(fitted), len(rest)) < 2 * design.shape[1]:
            continue
        values = np.linalg.lstsq(design, fitted.effort, rcond=None)[0]
        errors = rest.effort - general_design(rest, is_linear=is_linear) @ values
        logs.append(math.log(float(np.mean(errors**2)) + _TINY))
    return math.exp(0.5 * float(np.mean(logs))) if logs else math.inf
