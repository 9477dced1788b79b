# SPDX-License-Identifier: Apache-2.0
"""Estimation of a baseline from healthy records."""

import math
from collections.abc import Sequence

import numpy as np

from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.elasticity import with_elasticity
from ema_monitor.joint.lag import aligned, common_lag, effort_lag, with_shift
from ema_monitor.joint.record import FEWEST_ROWS, read_record, record_defect
from ema_monitor.joint.renewal import renewed, samples_per_update
from ema_monitor.joint.ripple import with_ripples
from ema_monitor.joint.shape import DRY, choose_shape
from ema_monitor.joint.signals import (
    Preparation,
    Signals,
    acquisition_lag,
    block_means,
    cutoff_of,
    filtered,
    motion_band,
    usual_speed,
)
from ema_monitor.joint.spikes import despiked
from ema_monitor.reason_texts import joined
from ema_monitor.reasons import EffortMissing, Reason, SpeedGaps, TooFewRows


def learn(
    records: Sequence[Telemetry],
    description: ActuatorDescription,
    *,
    temperatures: Sequence[float] = (),
) -> Baseline:
    """Return the baseline estimated from healthy records.

    A payload that is carried in just one direction looks like friction. If the payload is known in
    all records, the model is also fitted to the motion without a payload. This second baseline is
    returned if at least half of the records can be used without a payload, and the friction has a
    smaller error.

    Parameters
    ----------
    records
        Healthy records, at least one.
    description
        Description of the unit.
    temperatures
        Measured rise of the winding temperature of each record [K]; empty if not measured.

    Raises
    ------
    ValueError
        If there is no record, two records are identical, no record can be used, or the records do
        not determine the friction of the joint.
    """
    if not records:
        raise ValueError("a baseline needs at least one healthy record, got none")
    _require_different(records)
    temperatures = temperatures or [math.nan] * len(records)
    is_known = all(record.has_payload for record in records)
    is_carried = is_known and any(np.any(record.payload > 0.0) for record in records)
    # If no healthy record has a payload, motion with a payload is excluded from later records.
    variants = (False, True) if is_carried else (is_known,)
    baselines, errors = [], []
    for is_empty in variants:
        try:
            baselines.append(_learn(records, description, temperatures, is_empty=is_empty))
        except ValueError as error:
            errors.append(error)
    if not baselines:
        raise errors[0]
    everything, *empty = baselines
    if empty and 2 * len(empty[0].records) >= len(everything.records):
        return min(baselines, key=_friction_error)
    return everything


def _friction_error(baseline: Baseline) -> float:
    """Return the typical relative error of the friction of a healthy record [-]."""
    noise = float(np.median(baseline.covariances[:, DRY, DRY]))
    return math.hypot(baseline.shape.friction_error, math.sqrt(noise))


def _learn(
    records: Sequence[Telemetry],
    description: ActuatorDescription,
    temperatures: Sequence[float],
    *,
    is_empty: bool,
) -> Baseline:
    """Return the baseline from all motion, or, if ``is_empty``, from motion without a payload."""
    bands = [motion_band(record) for record in records]
    period = float(np.median([record.sample_period for record in records]))
    cutoff = cutoff_of(float(np.median(bands)), period)
    per_update = float(np.median([samples_per_update(record) for record in records]))
    records = [despiked(renewed(record), cutoff).telemetry for record in records]
    blocks = [block_means(record, description, cutoff, is_empty=is_empty) for record in records]
    usual = float(np.median([usual_speed(block, cutoff) for block in blocks]))
    if not usual > 0.0:
        raise ValueError("no motion: the position never changes in the healthy records")
    lag = acquisition_lag(description)
    preparation = Preparation(cutoff, lag, usual, samples_per_update=per_update, is_empty=is_empty)
    sample = blocks[:: max(1, len(blocks) // 4)]
    stiff, elastic = (
        variant._replace(lag_s=lag, unexpected_lag_s=lag - variant.lag_s)
        for variant in (preparation, preparation._replace(is_elastic=True))
        for lag in (common_lag(sample, variant),)
    )
    lags = [effort_lag(block, preparation) for block in blocks]
    lags = [with_shift(lag, lags, cutoff) for lag in lags]
    lags = [lag if lag.is_certain else lag.unshifted for lag in lags]
    blocks = [aligned(block, lag) for block, lag in zip(blocks, lags, strict=True)]
    signals = [filtered(block, preparation) for block in blocks]
    usable = [
        number
        for number, rows in enumerate(signals)
        if records[number].sample_period <= preparation.highest_period
        and record_defect(rows, preparation) is None
    ]
    if not usable:
        defect = record_defect(signals[0], preparation)
        raise ValueError(f"no healthy record can be used: {joined(filter(None, [defect]))}")
    is_linear = bool(description.parameters.lead)

    def prepared(variant: Preparation) -> list[Signals]:
        return [filtered(blocks[number], variant) for number in usable]

    preparation = with_elasticity(stiff, elastic, prepared, is_linear=is_linear)
    preparation, chosen = with_ripples(preparation, prepared, is_linear=is_linear)
    shape = choose_shape(chosen, is_linear=is_linear)
    readings = [
        read_record(
            records[number],
            description,
            preparation,
            shape,
            temperature=temperatures[number],
            prepared=(blocks[number], rows),
            effort_lag=lags[number],
        ).at_rate(records[number].sample_period, period)
        for number, rows in zip(usable, chosen, strict=True)
    ]
    return Baseline(preparation, shape, tuple(readings))


def unusable(telemetry: Telemetry, description: ActuatorDescription) -> Reason | None:
    """Return the reason why a record cannot be used as a healthy record, or None if it can."""
    if not len(telemetry.current):
        return EffortMissing()
    if not np.all(np.isfinite(telemetry.speed)):
        return SpeedGaps()
    cutoff = cutoff_of(motion_band(telemetry), telemetry.sample_period)
    record = despiked(renewed(telemetry), cutoff).telemetry
    blocks = block_means(record, description, cutoff)
    usual = usual_speed(blocks, cutoff)
    if not usual > 0.0:
        return TooFewRows(0, FEWEST_ROWS)
    preparation = Preparation(cutoff, acquisition_lag(description), usual)
    return record_defect(filtered(blocks, preparation), preparation)


def _require_different(records: Sequence[Telemetry]) -> None:
    """Raise ``ValueError`` if two records are identical: they would count as independent."""
    for number, record in enumerate(records):
        for before, earlier in enumerate(records[:number]):
            is_same = record.stamp_ns == earlier.stamp_ns and len(record) == len(earlier)
            if is_same and np.array_equal(record.current, earlier.current):
                raise ValueError(
                    f"healthy records {before + 1} and {number + 1} are identical: "
                    "pass each record once"
                )
