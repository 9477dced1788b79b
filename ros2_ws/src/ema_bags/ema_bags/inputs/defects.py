# SPDX-License-Identifier: Apache-2.0
"""Detection of defects in a mapping or in its data, before any estimate."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.commanded import find_commanded
from ema_bags.inputs.defect_kinds import DefectKind, kind_of_mistake
from ema_bags.inputs.held import held_columns
from ema_bags.inputs.input_defect import (
    Evidence,
    FarCommand,
    Frozen,
    InputDefect,
    LostSamples,
    OtherRate,
    PositionJumps,
    RepeatedSamples,
    RepeatedValues,
    SampleCount,
    ValuesNotFinite,
    WrongStamps,
)
from ema_bags.inputs.mapping import ColumnMapping
from ema_bags.inputs.motion import ThinnedMotion
from ema_bags.inputs.rate import Rate
from ema_bags.inputs.resampling import Losses
from ema_bags.inputs.wrong_columns import current_defects, wrong_factors
from ema_core.columns.frozen import frozen_column
from ema_core.description import ActuatorDescription

_LEAST_TRAVEL: Final = 1e-3
_MANY: Final = 0.01
_SAME_RATE: Final = 2e-3
_SIMILAR_RATE: Final = 0.1
_GAP: Final = 1.5
_LEAST_STEPS: Final = 200
_JUMP: Final = 4.0
_SUDDEN: Final = 20.0
_CATCHES_UP: Final = 1.5
# Samples per position update, below which irregular updates are ignored for a modelled drive.
_FEW_REPEATS: Final = 1.5
_FAR_BEYOND: Final = 2.0
_JUMP_OF_RANGE: Final = 0.05
_NEIGHBOURS: Final = 3
"""Number of nonzero position steps on each side with which a jump is compared."""
_FIRST_JUDGED: Final = 20
_FROZEN_MOTION: Final = frozenset(
    (DefectKind.COMMAND_FROZEN, DefectKind.POSITION_FROZEN, DefectKind.SPEED_FROZEN)
)
"""Defects of columns whose ratios to other columns have no meaning."""


def find_defects(
    columns: dict[str, NDArray[np.float64]],
    stamps_ns: NDArray[np.int64],
    mapping: ColumnMapping,
    description: ActuatorDescription,
    updated_hz: float | None = None,
) -> list[InputDefect]:
    """Return the defects found in converted telemetry columns.

    Wrong signs and units are only detected if the recording contains motion.

    Parameters
    ----------
    columns
        Columns returned by ``ema_bags.inputs.conversion.convert``, ``(n,)`` or empty.
    stamps_ns
        Stamps of the samples, ``(n,)`` [ns].
    updated_hz
        Update rate of the source [Hz] if it publishes each value several times; else None.
    """
    defects = list(_other_drive(mapping, description))
    defects += _held(columns, stamps_ns, is_unknown=not description.is_modelled)
    defects += _jumps(columns["position"], stamps_ns)
    defects += _beyond_travel(columns["command"], columns["position"])
    motion = ThinnedMotion.of(columns, stamps_ns, description.parameters.tau)
    if motion is None:
        return defects
    defects += _frozen(columns, motion, is_unknown=not description.is_modelled)
    if not any(item.kind in _FROZEN_MOTION for item in defects):
        # If position or speed repeats values, their ratio reflects delays, not gears.
        if not any(item.kind is DefectKind.VALUES_REPEAT and item.is_error for item in defects):
            defects += wrong_factors(motion, mapping, description, updated_hz)
        defects += find_commanded(columns, description.parameters.tau)
    if not any(item.is_error for item in defects):
        defects += current_defects(motion, mapping, description)
    if mapping.position.shaft == "motor":
        defects.append(_remark(DefectKind.POSITION_AT_MOTOR))
    return defects


def stream_defects(
    losses: Losses, rebuilt: int, *, of_table: bool = False, is_unknown: bool = False
) -> Iterator[InputDefect]:
    """Yield defects in time stamps and lost, repeated or impossible samples.

    Parameters
    ----------
    losses
        Counts of lost and irregular samples.
    rebuilt
        Number of stamps reconstructed from arrival times.
    of_table
        Whether the samples are table rows, which have no arrival time.
    is_unknown
        Whether the drive is unknown; its records are interpolated across short gaps.
    """
    n = max(losses.samples, 1)
    if losses.lost:
        lost = LostSamples(losses.lost, n, losses.gaps, is_interpolated=is_unknown)
        yield InputDefect(DefectKind.LOST_SAMPLES, lost, is_error=False)
    if losses.filled:
        filled = SampleCount(losses.filled, n)
        yield InputDefect(DefectKind.FILLED_SAMPLES, filled, is_error=False)
    if bad := losses.jumps + losses.repeated:
        stamps = WrongStamps(losses.jumps, losses.repeated, n, of_table)
        yield InputDefect(DefectKind.TIME_NOT_MONOTONIC, stamps, is_error=bad > _MANY * n)
    if losses.reordered:
        yield _remark(DefectKind.SAMPLES_REORDERED, SampleCount(losses.reordered, n))
    if losses.duplicates:
        yield _remark(DefectKind.DUPLICATE_SAMPLES, SampleCount(losses.duplicates, n))
    if losses.impossible:
        impossible = SampleCount(losses.impossible, n)
        is_error = losses.impossible > _MANY * n
        yield InputDefect(
            DefectKind.IMPOSSIBLE_SAMPLES, impossible, is_error, needs_action=is_error
        )
    if losses.wraps:
        yield _remark(DefectKind.ANGLE_WRAPS, SampleCount(losses.wraps, n))
    if rebuilt:
        yield InputDefect(DefectKind.STAMPS_REBUILT, SampleCount(rebuilt, n), is_error=False)


def not_finite(columns: dict[str, NDArray[np.float64]]) -> Iterator[InputDefect]:
    """Yield a defect if any column, ``(n,)`` or empty, contains NaN or infinite values."""
    bad = {name: ~np.isfinite(values) for name, values in columns.items() if len(values)}
    is_bad = np.any(list(bad.values()), axis=0)
    if np.any(is_bad):
        counts = {name: int(np.count_nonzero(rows)) for name, rows in bad.items() if np.any(rows)}
        evidence = ValuesNotFinite(counts, len(is_bad))
        yield InputDefect(DefectKind.NOT_FINITE, evidence, is_error=bool(np.mean(is_bad) > 0.5))


def other_rate(rate: Rate, description: ActuatorDescription) -> Iterator[InputDefect]:
    """Yield a defect if the sample rate differs by 0.2 % to 10 % from the description."""
    described = description.sample_period
    if _SAME_RATE < abs(rate.period / described - 1.0) < _SIMILAR_RATE:
        yield _remark(DefectKind.OTHER_RATE, OtherRate(1.0 / rate.period, 1.0 / described))


def renewed_slowly(rate: Rate, times: float) -> InputDefect:
    """Return the defect for values that are each published several times.

    ``rate`` is the rate at which values change, ``times`` the number of samples per value.
    """
    return _remark(DefectKind.VALUES_REPEAT, RepeatedSamples(times, 1.0 / rate.period))


def refused(defects: Iterable[InputDefect], mapping: ColumnMapping) -> list[InputDefect]:
    """Return the errors that the mapping does not accept; they prevent estimates."""
    return [item for item in defects if item.is_error and item.kind not in mapping.accept]


def withholding(defects: Iterable[InputDefect], mapping: ColumnMapping) -> list[InputDefect]:
    """Return the certain errors that the mapping does not accept; live telemetry is withheld."""
    return [item for item in refused(defects, mapping) if item.is_certain]


def _remark(kind: DefectKind, evidence: Evidence | None = None) -> InputDefect:
    """Return a defect that is informative only."""
    return InputDefect(kind, evidence, is_error=False, needs_action=False)


def _other_drive(mapping: ColumnMapping, description: ActuatorDescription) -> Iterator[InputDefect]:
    current = mapping.measured_current
    if current is not None and current.kind == "i_q" and description.drive == "six_step":
        yield InputDefect(DefectKind.DRIVE_OF_I_Q)


def _held(
    columns: dict[str, NDArray[np.float64]], stamps_ns: NDArray[np.int64], *, is_unknown: bool
) -> Iterator[InputDefect]:
    """Yield a defect if sensor columns are updated more slowly than they are published.

    The model of a known drive would interpret the resulting steps as faults.
    """
    # A table with repeated values is already reduced to its update rate.
    held = [
        item
        for item in held_columns(columns)
        if item.is_regular or is_unknown or item.mean >= _FEW_REPEATS
    ]
    if held:
        rate_hz = 1e9 / max(float(np.median(np.diff(stamps_ns))), 1.0)
        yield InputDefect(
            DefectKind.VALUES_REPEAT,
            RepeatedValues(tuple(held), rate_hz),
            is_error=not is_unknown,
            needs_action=not is_unknown,
        )


def _jumps(position: NDArray[np.float64], stamps_ns: NDArray[np.int64]) -> Iterator[InputDefect]:
    """Yield a defect if the position jumps further than any acceleration in the recording explains.

    Before and after a jump, the step size must change by more than 20 times both the largest nearby
    change and the 95th percentile of all changes. The jump must also exceed 4 times the 99.5th
    percentile of the steps and 5 % of the travel. Zero steps are ignored. A step is only judged
    once more motion follows, because the first step after a rest looks like a jump.
    """
    steps, usual_ns = np.diff(position), np.median(np.diff(stamps_ns))
    is_moving = (np.diff(stamps_ns) < _GAP * usual_ns) & np.isfinite(steps) & (steps != 0.0)
    rows = np.flatnonzero(is_moving)
    moving = steps[rows]
    if len(moving) < _LEAST_STEPS:
        return
    changes = np.abs(np.diff(moving, prepend=0.0))
    sizes = np.abs(moving)
    least_jump = max(
        _JUMP * float(np.percentile(sizes, 99.5)), _JUMP_OF_RANGE * float(np.ptp(position))
    )
    is_far = sizes > least_jump
    # Fast motion takes several long steps in one direction; a jump takes one, and may reverse.
    direction = np.where(is_far, np.sign(moving), 0.0)
    is_isolated = (
        is_far
        & (np.append(direction[1:], 0.0) != direction)
        & (np.append(0.0, direction[:-1]) != direction)
    )
    next_to_jump = is_isolated | np.append(False, is_isolated[:-1])
    padded = np.concatenate(
        [
            np.zeros(_NEIGHBOURS),
            np.where(next_to_jump, 0.0, changes),
            np.full(_NEIGHBOURS + 1, np.inf),
        ]
    )
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 2)
    nearby = np.max(np.delete(around, [_NEIGHBOURS, _NEIGHBOURS + 1], axis=1), axis=1)
    sudden = _SUDDEN * np.maximum(nearby, float(np.percentile(changes, 95.0)))
    is_jump = is_isolated & (np.minimum(changes, np.append(changes[1:], np.inf)) > sudden)
    # After repeated values during motion, one longer step catches up.
    repeated = np.diff(rows, prepend=-1)
    padded = np.pad(sizes, _NEIGHBOURS)
    speeds = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
    speed = np.minimum(
        np.max(speeds[:, :_NEIGHBOURS], axis=1), np.max(speeds[:, -_NEIGHBOURS:], axis=1)
    )
    is_late = (repeated > 1) & (sizes < _CATCHES_UP * repeated * speed)
    is_jump &= ~is_late
    # Jumps in the first rows are ignored, because the steps before them are unknown.
    jumps = sizes[is_jump & (rows >= _FIRST_JUDGED)]
    if 0 < len(jumps) <= _MANY * len(steps):
        evidence = PositionJumps(len(jumps), float(np.max(jumps)))
        yield InputDefect(DefectKind.POSITION_JUMPS, evidence)


def _beyond_travel(
    command: NDArray[np.float64], position: NDArray[np.float64]
) -> Iterator[InputDefect]:
    """Yield a defect if the command temporarily lies far outside the usual range of motion."""
    if not np.any(np.isfinite(command)):
        return
    usual = np.concatenate([command, position])
    low, high = np.nanpercentile(usual, [1.0, 99.0])
    is_beyond = np.abs(command - 0.5 * (low + high)) > _FAR_BEYOND * (high - low)
    count = int(np.count_nonzero(is_beyond))
    if not 0 < count <= _MANY * len(command) or is_beyond[-1] or not high > low:
        return
    first = float(command[is_beyond][0])
    evidence = FarCommand(first, float(low), float(high), count, len(command))
    yield InputDefect(DefectKind.COMMAND_RANGE, evidence, is_certain=False)


def _frozen(
    columns: dict[str, NDArray[np.float64]], motion: ThinnedMotion, *, is_unknown: bool
) -> Iterator[InputDefect]:
    # A joint may still be settling after its command has stopped.
    is_certain = not is_unknown or motion.is_ample
    moves = {name: motion.travel(name) > _LEAST_TRAVEL for name in ("command", "position")}
    moves["command"] &= len(columns["command"]) > 0
    moves["speed"] = motion.has_speed and motion.turned > _LEAST_TRAVEL
    moving = [name for name, is_moving in moves.items() if is_moving]
    for name in ("command", "position", "speed", "current"):
        error = frozen_column(name, columns[name], moving)
        if error is None:
            continue
        is_optional = name in ("current", "speed") or (name == "command" and is_unknown)
        kind = kind_of_mistake(name, error.kind)
        if name == "current" and error.value == 0.0:
            kind = DefectKind.CURRENT_ZERO
        yield InputDefect(kind, Frozen(error, is_optional), is_certain=is_certain)
