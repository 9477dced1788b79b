"""Making a baseline from healthy records."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.elasticity import with_elasticity
from ema_monitor.joint.lag import aligned, effort_lag, with_shift
from ema_monitor.joint.record import defect_of, read_record
from ema_monitor.joint.ripple import with_ripples
from ema_monitor.joint.shape import choose_shape
from ema_monitor.joint.signals import (
    Fine,
    Preparation,
    Signals,
    block_means,
    cutoff_of,
    filtered,
    known_lag,
    motion_band,
    usual_speed,
)

_LAG_GAIN: Final = 0.9
_LAGS_S: Final = (-0.02, -0.01, 0.005, 0.01, 0.02, 0.04, 0.08)
_LAG_SAMPLES: Final = (-1.0, -0.5, 0.5, 1.0, 1.5, 2.0)


def learn(
    records: Sequence[Telemetry],
    description: ActuatorDescription,
    *,
    temperatures: Sequence[float] = (),
) -> Baseline:
    """Return the baseline of healthy records.

    Parameters
    ----------
    records
        Healthy records, at least one.
    description
        The unit.
    temperatures
        Measured rise of the winding temperature of each record [K]; empty where none was measured.

    Raises
    ------
    ValueError
        When there is no record, or the records do not show the friction of the joint.
    """
    if not records:
        raise ValueError("a baseline needs at least one healthy record, got none")
    _require_different(records)
    bands = [motion_band(one) for one in records]
    period = float(np.median([one.sample_period for one in records]))
    cutoff = cutoff_of(float(np.median(bands)), period)
    blocks = [block_means(one, description, cutoff) for one in records]
    usual = float(np.median([usual_speed(one, cutoff) for one in blocks]))
    if not usual > 0.0:
        raise ValueError("no motion: the position never changes in the healthy records")
    preparation = Preparation(cutoff, known_lag(description), usual)
    preparation = _with_lag(preparation, blocks, period)
    lags = [effort_lag(one, preparation) for one in blocks]
    lags = [with_shift(one, lags, cutoff) for one in lags]
    lags = [one if one.is_certain else one.unshifted for one in lags]
    blocks = [aligned(one, lag) for one, lag in zip(blocks, lags, strict=True)]
    signals = [filtered(one, preparation) for one in blocks]
    usable = [number for number, one in enumerate(signals) if not defect_of(one, preparation)]
    if not usable:
        raise ValueError(f"no healthy record can be used: {defect_of(signals[0], preparation)}")
    is_linear = bool(description.parameters.lead)

    def prepared(wanted: Preparation) -> list[Signals]:
        return [filtered(blocks[number], wanted) for number in usable]

    preparation = with_elasticity(preparation, prepared, is_linear=is_linear)
    preparation, chosen = with_ripples(preparation, prepared, is_linear=is_linear)
    shape = choose_shape(chosen, is_linear=is_linear)
    found = [
        read_record(
            records[number],
            description,
            preparation,
            shape,
            temperature=temperatures[number] if temperatures else math.nan,
            prepared=(blocks[number], rows),
            effort_lag=lags[number],
        )
        for number, rows in zip(usable, chosen, strict=True)
    ]
    return Baseline(preparation, shape, tuple(found))


def _require_different(records: Sequence[Telemetry]) -> None:
    """Raise ``ValueError`` where a record is there twice: it would pass for a second record."""
    for number, one in enumerate(records):
        for before, other in enumerate(records[:number]):
            is_same = one.stamp_ns == other.stamp_ns and len(one) == len(other)
            if is_same and np.array_equal(one.current, other.current):
                raise ValueError(
                    f"healthy records {before + 1} and {number + 1} are the same: give each once"
                )


def _with_lag(preparation: Preparation, blocks: Sequence[Fine], period: float) -> Preparation:
    """Return the preparation with the lag of the effort, if one explains the effort clearly."""
    base = preparation.lag_s
    lags = sorted(
        {base, *(base + one * period for one in _LAG_SAMPLES), *(base + s for s in _LAGS_S)}
    )
    some = blocks[:: max(1, len(blocks) // 4)]
    errors = {lag: _misfit(some, preparation._replace(lag_s=lag)) for lag in lags}
    best = min(errors, key=lambda lag: errors[lag])
    if best in (lags[0], lags[-1]) or errors[best] > _LAG_GAIN * errors[base]:
        return preparation
    return preparation._replace(lag_s=best)


def _misfit(blocks: Sequence[Fine], preparation: Preparation) -> float:
    """Return what a model of friction, inertia and gravity misses of the effort, rms [A]."""
    total, count = 0.0, 0
    for one in blocks:
        signals: Signals = filtered(one, preparation)
        if len(signals) < 30:
            continue
        angle = signals.position - np.mean(signals.position)
        design = np.column_stack(
            [
                signals.acceleration,
                signals.speed,
                signals.direction,
                np.ones(len(signals)),
                np.sin(angle),
                np.cos(angle),
            ]
        )
        left = signals.effort - design @ np.linalg.lstsq(design, signals.effort, rcond=None)[0]
        total, count = total + float(left @ left), count + len(left)
    return math.sqrt(total / count) if count else math.inf
