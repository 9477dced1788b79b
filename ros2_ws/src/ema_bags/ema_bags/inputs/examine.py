# SPDX-License-Identifier: Apache-2.0
"""Examination of files, bags and topics: the role of each column, defects, possible judgements.

``examine`` reads a file or bag, ``examine_topics`` takes collected messages. Both return the same
``Examination``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.abilities import abilities_of
from ema_bags.inputs.column_measures import (
    EffortFit,
    fit_effort,
    held_values,
    lag_between,
    moving_mask,
    quantisation_step,
    saturated_share,
    smoothed,
)
from ema_bags.inputs.conversion import decoded, with_lead
from ema_bags.inputs.examination import (
    ColumnExamination,
    Examination,
    JointExamination,
    JointMotion,
    JointRelations,
    Timing,
)
from ema_bags.inputs.files import open_input
from ema_bags.inputs.guess import Guess, refine
from ema_bags.inputs.importing import Imported, import_series, primary_stamps
from ema_bags.inputs.joint_topics import JointTopics
from ema_bags.inputs.mapping import Clock, ColumnMapping
from ema_bags.inputs.motion import ThinnedMotion, reversals
from ema_bags.inputs.ordering import sorting_order
from ema_bags.inputs.rate import find_rate
from ema_bags.inputs.resampling import GaplessRun
from ema_bags.inputs.series import Series, join_topics
from ema_core.description import ActuatorDescription
from ema_core.parameters import NEUTRAL, ActuatorParameters
from ema_core.record_needs import LONGEST_STROKE_S
from ema_core.telemetry import PAUSE_S
from ema_core.units import LINEAR

_Array = NDArray[np.float64]

UNKNOWN_JOINT: Final = ActuatorDescription(
    "joint", "unknown", "", drive="unknown", parameters=replace(ActuatorParameters(), **NEUTRAL)
)
"""Description of a joint without a data sheet."""

_FEWEST_SAMPLES: Final = 3
_MOST_FITTED: Final = 10_000
_SHORT_STROKE: Final = 0.2
_MOVING_S: Final = 0.05


class _Recognised(NamedTuple):
    """A joint to examine: its mapping and its mapped series by topic."""

    guess: Guess
    by_topic: Mapping[str, Series]


def examine(
    path: Path,
    description: ActuatorDescription = UNKNOWN_JOINT,
    *,
    mapping: ColumnMapping | None = None,
    clock: Clock | None = None,
    joints: Sequence[str] = (),
) -> Examination:
    """Examine a file, bag or data set.

    Parameters
    ----------
    path
        Table, bag, or folder of a bag or of a LeRobot data set.
    description
        Description of the actuator; by default a joint without a data sheet.
    mapping
        Known mapping; None to recognise the columns.
    clock
        Known clock of a table; None to recognise it.
    joints
        Names of the joints to examine; empty for all.

    Raises
    ------
    ValueError
        If the file cannot be read, holds no joint, or lacks one of ``joints``.
    OSError
        If the file cannot be opened.
    """
    file = open_input(path, mapping)
    if mapping is not None:
        parts = [mapping.of_joint(name) for name in mapping.joints] or [mapping]
        guesses = [Guess(part, (), part.joint) for part in parts]
        recognised = [_Recognised(guess, file.series(guess.mapping)) for guess in guesses]
    else:
        recognised = [_Recognised(*item) for item in file.recognised(description, clock)]
    results = _examined(recognised, description, joints, is_mapped=mapping is not None)
    return Examination(str(path), file.names, results, tuple(file.remarks))


def examine_topics(
    topics: JointTopics,
    source: str,
    description: ActuatorDescription = UNKNOWN_JOINT,
    *,
    joints: Sequence[str] = (),
) -> Examination:
    """Examine the joints on topics, from the messages collected so far.

    Parameters
    ----------
    topics
        Collected messages.
    source
        Name of the source, for the report.
    description
        Description of the actuators; by default joints without a data sheet.
    joints
        Names of the joints to examine; empty for all.

    Raises
    ------
    ValueError
        If no topic holds a joint, or one of ``joints`` is missing.
    """
    recognised = [_Recognised(item.guess, item.by_topic) for item in topics.joints()]
    if not recognised:
        listed = ", ".join(f"{name} ({kind})" for name, kind in topics.topics.items()) or "none"
        raise ValueError(f"{source}: no message holds a joint; topics: {listed}")
    return Examination(
        source, tuple(topics.topics), _examined(recognised, description, joints, is_mapped=False)
    )


def _examined(
    recognised: Sequence[_Recognised],
    description: ActuatorDescription,
    joints: Sequence[str],
    *,
    is_mapped: bool,
) -> tuple[JointExamination, ...]:
    names = [item.guess.joint or item.guess.mapping.joint for item in recognised]
    if unknown := [name for name in joints if name not in names]:
        raise ValueError(
            f"there is no joint {unknown[0]!r}: expected {', '.join(map(repr, names))}"
        )
    return tuple(
        _examine_joint(item, name, description, is_mapped=is_mapped)
        for name, item in zip(names, recognised, strict=True)
        if not joints or name in joints
    )


def _examine_joint(
    recognised: _Recognised, name: str, description: ActuatorDescription, *, is_mapped: bool
) -> JointExamination:
    guess, by_topic = recognised
    try:
        stamps, raw = _joined(by_topic, guess.mapping)
        if not is_mapped:
            guess = refine(guess, raw, stamps, description)
            stamps, raw = _joined(by_topic, guess.mapping)
        imported = import_series(by_topic, guess.mapping, description)
    except ValueError as error:
        mapping = guess.mapping
        results = abilities_of(mapping, description, None, None, None, ())
        return JointExamination(
            name, mapping, (), guess.doubts, None, None, None, 0, 0, "", results, (), str(error)
        )
    mapping = guess.mapping
    columns = tuple(_columns(guess, raw, stamps))
    described = {column.quantity for column in columns}
    motion = _motion(imported, mapping, description)
    relations, fit = _relations(imported)
    defects = tuple(imported.defects)
    losses = imported.stream.losses
    return JointExamination(
        name,
        mapping,
        columns,
        tuple(item for item in guess.doubts if item.quantity not in described),
        _timing(imported, stamps),
        relations,
        motion,
        losses.wraps,
        losses.impossible,
        guess.second_position,
        abilities_of(mapping, description, motion, relations, fit, defects),
        defects,
    )


def _joined(
    by_topic: Mapping[str, Series], mapping: ColumnMapping
) -> tuple[NDArray[np.int64], dict[str, _Array]]:
    """Return stamps [ns] and source values by key, in the order of the samples."""
    primary = by_topic[mapping.position.topic]
    if len(primary) < 2:
        raise ValueError(f"{len(primary)} samples of the position: expected at least 2")
    stamps, _ = primary_stamps(primary, mapping)
    return stamps, join_topics(by_topic, mapping, stamps)


def _timing(imported: Imported, stamps_ns: NDArray[np.int64]) -> Timing:
    order = sorting_order(stamps_ns)
    stamps = stamps_ns if order is None else stamps_ns[order]
    rate = find_rate(stamps, imported.mapping.clock.rate_hz)
    losses = imported.stream.losses
    return Timing(
        1.0 / rate.measured_period,
        0.0 if imported.rebuilt == len(stamps) else rate.jitter,
        1e-9 * float(np.ptp(stamps)),
        len(stamps),
        losses.lost + losses.filled,
        losses.gaps,
        losses.pauses,
        losses.jumps,
        losses.repeated + losses.duplicates,
        losses.reordered,
        imported.rebuilt,
    )


def _columns(
    guess: Guess, raw: Mapping[str, _Array], stamps_ns: NDArray[np.int64]
) -> list[ColumnExamination]:
    """Return statistics of each mapped column, in the unit of its source."""
    mapping = guess.mapping
    steps = np.diff(stamps_ns)
    period = 1e-9 * float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0
    position = _without_gaps(raw["position"])
    is_moving = moving_mask(np.gradient(smoothed(position, period, _MOVING_S)))
    columns = []
    for key, text, source in mapping.wanted():
        name = next(quantity for quantity, item in mapping.sources() if item is source)
        values = decoded(raw[key], source.encoding)
        finite = values[np.isfinite(values)]
        repetition = held_values(values, is_moving)
        columns.append(
            ColumnExamination(
                name,
                text,
                source.topic,
                source.unit,
                tuple(doubt for doubt in guess.doubts if doubt.quantity == name),
                float(np.min(finite, initial=math.inf)) if len(finite) else math.nan,
                float(np.max(finite, initial=-math.inf)) if len(finite) else math.nan,
                quantisation_step(values),
                repetition.every,
                repetition.share,
                repetition.longest,
                saturated_share(values),
                len(values) - len(finite),
            )
        )
    return columns


def _without_gaps(values: _Array) -> _Array:
    rows = np.flatnonzero(np.isfinite(values))
    if len(rows) in (0, len(values)):
        return np.nan_to_num(values)
    return np.interp(np.arange(len(values)), rows, values[rows])


def _pieces(imported: Imported) -> list[dict[str, _Array]]:
    """Return the columns of each piece without a pause; gaps of at most 1 s are interpolated."""
    period_ns = 1e9 * imported.rate.period
    groups: list[list[GaplessRun]] = []
    for run in imported.runs:
        gap_s = 1e-9 * float(run.stamps_ns[0] - groups[-1][-1].stamps_ns[-1]) if groups else -1.0
        if 0.0 < gap_s <= PAUSE_S:
            groups[-1].append(run)
        else:
            groups.append([run])
    pieces = []
    for group in groups:
        stamps = np.concatenate([run.stamps_ns for run in group])
        values = np.concatenate([run.values for run in group])
        at = (stamps - stamps[0]).astype(float)
        grid = period_ns * np.arange(1 + round(at[-1] / period_ns))
        if len(grid) < _FEWEST_SAMPLES:
            continue
        pieces.append(
            {
                name: np.interp(grid, at, values[:, number])
                for number, name in enumerate(imported.stream.filled)
            }
        )
    return pieces


def _motion(
    imported: Imported, mapping: ColumnMapping, description: ActuatorDescription
) -> JointMotion | None:
    """Return the motion over all gapless runs; None without a run of several samples."""
    period = imported.rate.period
    runs = [piece["position"] for piece in _pieces(imported)]
    if not runs:
        return None
    is_linear = mapping.position.unit in LINEAR
    lead = with_lead(description, mapping).parameters.lead
    size = lead / (2.0 * math.pi) if is_linear and lead else 1.0
    positions = np.concatenate(runs)
    travel = float(np.ptp(positions))
    speeds = [np.gradient(smoothed(run, period, _MOVING_S), period) for run in runs]
    all_speeds = np.abs(np.concatenate(speeds))
    is_moving = moving_mask(all_speeds)
    moving = all_speeds[is_moving]
    if not len(moving) or travel <= 0.0:
        return JointMotion("m" if is_linear else "rad", travel * size, 0, 0, 0, 0.0, 0.0, 0.0, 0.0)
    limit = float(np.min(moving))
    strokes, pieces = [0, 0], [0, 0]
    for run, speed in zip(runs, speeds, strict=True):
        for direction, seconds in _strokes(run, speed, period, travel, limit):
            strokes[direction] += 1
            pieces[direction] += 1 + int(seconds / LONGEST_STROKE_S)
    slow, fast = np.percentile(moving, [5.0, 95.0])
    return JointMotion(
        "m" if is_linear else "rad",
        travel * size,
        strokes[0],
        strokes[1],
        min(pieces),
        float(slow) * size,
        float(fast) * size,
        float(np.std(moving) / np.mean(moving)),
        len(moving) * period,
    )


def _strokes(
    position: _Array, speed: _Array, period: float, travel: float, limit: float
) -> list[tuple[int, float]]:
    """Return direction (0 forward, 1 backward) and time in motion [s] of each stroke of a run."""
    ends = reversals(position)
    strokes = []
    for first, last in pairwise(ends):
        distance = float(position[last] - position[first])
        if (abs(distance) <= _SHORT_STROKE * 0.5 * travel and len(ends) > 2) or last <= first:
            continue
        seconds = float(np.count_nonzero(np.abs(speed[first:last]) >= limit)) * period
        if seconds > 0.0:
            strokes.append((int(distance < 0.0), seconds))
    return strokes


def _speed_factor(
    position: _Array, speed: _Array, lag_s: float, period: float, tau: float
) -> float:
    """Return the speed divided by the derivative of the position; NaN if unknown.

    The lag of the speed is removed first.
    """
    shift = round(lag_s / period) if math.isfinite(lag_s) else 0
    n = len(position) - abs(shift)
    empty = np.empty(0)
    columns = {
        "position": position[max(0, -shift) :][:n],
        "speed": speed[max(0, shift) :][:n],
        "command": empty,
        "current": empty,
    }
    stamps_ns = np.rint(1e9 * period * np.arange(n)).astype(np.int64)
    motion = ThinnedMotion.of(columns, stamps_ns, tau)
    ratio = motion.stroke_ratio if motion else None
    return 1.0 / ratio if ratio else math.nan


def _relations(imported: Imported) -> tuple[JointRelations | None, EffortFit | None]:
    """Return lags and factors in the longest gapless run, and the fit of the effort."""
    period, tau = imported.rate.period, imported.description.parameters.tau
    columns = max(_pieces(imported), key=lambda item: len(item["position"]), default={})
    if not columns:
        return None, None
    position = columns["position"]
    if len(position) < 50 or float(np.ptp(position)) <= 0.0:
        return None, None
    rate = np.gradient(smoothed(position, period), period)
    speed_lag = command_lag = factor = math.nan
    if "speed" in columns:
        speed_lag = lag_between(rate, smoothed(columns["speed"], period) * tau, period)
        factor = _speed_factor(position, columns["speed"], speed_lag, period, tau)
    if "command" in columns:
        commanded_rate = np.gradient(smoothed(columns["command"], period), period)
        command_lag = lag_between(commanded_rate, rate, period)
    fit = None
    if "current" in columns:
        start = max(0, (len(position) - _MOST_FITTED) // 2)
        part = slice(start, start + _MOST_FITTED)
        fit = fit_effort(position[part], columns["current"][part], period)
    return (
        JointRelations(
            command_lag,
            speed_lag,
            fit.lag_s if fit else math.nan,
            factor,
            fit.explained if fit else math.nan,
        ),
        fit,
    )
