# SPDX-License-Identifier: Apache-2.0
"""Detection of defects in a mapping or in its data, before any estimate."""

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.commanded import find_commanded
from ema_bags.inputs.defect_kinds import DefectKind, kind_of_mistake
from ema_bags.inputs.held import held_columns
from ema_bags.inputs.input_defect import InputDefect
from ema_bags.inputs.mapping import ColumnMapping
from ema_bags.inputs.motion import ThinnedMotion
from ema_bags.inputs.ordering import MOST_DISPLACED
from ema_bags.inputs.rate import Rate
from ema_bags.inputs.resampling import Losses
from ema_bags.inputs.wrong_columns import current_defects, wrong_factors
from ema_core.columns.frozen import frozen_column
from ema_core.description import ActuatorDescription
from ema_core.telemetry import PAUSE_S
from ema_core.wording import counted

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
        text = "the position is measured at the motor, upstream of the backlash"
        remedy = "backlash is not visible in it; use an encoder at the user shaft"
        defects.append(
            InputDefect(DefectKind.POSITION_AT_MOTOR, text, remedy, False, needs_action=False)
        )
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
        text = (
            f"{counted(losses.lost, 'sample')} of {n + losses.lost} missing in "
            f"{counted(losses.gaps, 'gap')}"
        )
        remedy = "no window spans a gap; set fill_lost in the mapping to fill short gaps"
        if is_unknown:
            remedy = f"records are interpolated across gaps of at most {PAUSE_S:g} s"
        yield InputDefect(DefectKind.LOST_SAMPLES, text, remedy, False)
    if losses.filled:
        text = (
            f"{counted(losses.filled, 'lost sample')} interpolated linearly (fill_lost), in "
            f"addition to {n} received"
        )
        remedy = "interpolated currents are estimates: reduce losses at the source"
        yield InputDefect(DefectKind.FILLED_SAMPLES, text, remedy, False)
    if bad := losses.jumps + losses.repeated:
        text = (
            f"the time decreases {counted(losses.jumps, 'time')} and repeats "
            f"{counted(losses.repeated, 'time')} in {counted(n, 'sample')}"
        )
        remedy = "samples with a repeated stamp are dropped, and no window spans a backward step"
        if is_error := bad > _MANY * n:
            order = "Sort the rows by time"
            rebuild = "clock: {source: arrival} reconstructs the stamps"
            remedy = f"check clock.source. {order if of_table else rebuild}"
        yield InputDefect(DefectKind.TIME_NOT_MONOTONIC, text, remedy, is_error)
    if losses.reordered:
        text = f"{counted(losses.reordered, 'sample')} of {n} out of order by at most "
        text += f"{counted(MOST_DISPLACED, 'sample')}"
        remedy = "they are sorted by stamp"
        yield InputDefect(DefectKind.SAMPLES_REORDERED, text, remedy, False, needs_action=False)
    if losses.duplicates:
        text = f"{counted(losses.duplicates, 'sample')} of {n} published twice"
        yield InputDefect(
            DefectKind.DUPLICATE_SAMPLES,
            text,
            "each sample is used once",
            False,
            needs_action=False,
        )
    if losses.impossible:
        text = f"{counted(losses.impossible, 'sample')} of {n} physically impossible"
        remedy = "they are interpolated linearly, or dropped as a gap"
        if is_error := losses.impossible > _MANY * n:
            remedy = "repair the source: too many to interpolate"
        yield InputDefect(
            DefectKind.IMPOSSIBLE_SAMPLES, text, remedy, is_error, needs_action=is_error
        )
    if losses.wraps:
        text = f"an angle wraps {counted(losses.wraps, 'time')} at the end of its register"
        yield InputDefect(
            DefectKind.ANGLE_WRAPS, text, "the angle is unwrapped", False, needs_action=False
        )
    if rebuilt:
        text = f"{counted(rebuilt, 'stamp')} of {n} reconstructed from arrival times"
        remedy = "set header.stamp at the source if possible"
        yield InputDefect(DefectKind.STAMPS_REBUILT, text, remedy, False)


def not_finite(columns: dict[str, NDArray[np.float64]]) -> Iterator[InputDefect]:
    """Yield a defect if any column, ``(n,)`` or empty, contains NaN or infinite values."""
    bad = {name: ~np.isfinite(values) for name, values in columns.items() if len(values)}
    is_bad = np.any(list(bad.values()), axis=0)
    if not np.any(is_bad):
        return
    parts = [(name, int(np.count_nonzero(rows))) for name, rows in bad.items() if np.any(rows)]
    text = ", ".join(f"{name} is not finite in {count}" for name, count in parts)
    remedy = "these samples are dropped"
    if is_error := bool(np.mean(is_bad) > 0.5):
        name = max(parts, key=lambda item: item[1])[0]
        remedy = f"{name}: repair its source or choose another source"
        if name in ("current", "speed"):
            remedy += f", or omit {name} if it is not measured"
    yield InputDefect(
        DefectKind.NOT_FINITE, f"{text} of {counted(len(is_bad), 'sample')}", remedy, is_error
    )


def other_rate(rate: Rate, description: ActuatorDescription) -> Iterator[InputDefect]:
    """Yield a defect if the sample rate differs by 0.2 % to 10 % from the description."""
    described = description.sample_period
    if _SAME_RATE < abs(rate.period / described - 1.0) < _SIMILAR_RATE:
        text = (
            f"the sample rate is {1.0 / rate.period:.5g} Hz, but the description has "
            f"{1.0 / described:g} Hz"
        )
        yield InputDefect(
            DefectKind.OTHER_RATE, text, "the measured rate is used", False, needs_action=False
        )


def renewed_slowly(rate: Rate, times: float) -> InputDefect:
    """Return the defect for values that are each published several times.

    ``rate`` is the rate at which values change, ``times`` the number of samples per value.
    """
    text = (
        f"each value is published {round(times)} times: updated at {1.0 / rate.period:.5g} Hz, "
        f"published at {times / rate.period:.4g} Hz"
    )
    remedy = f"the telemetry uses the update rate, {1.0 / rate.period:.5g} Hz"
    return InputDefect(DefectKind.VALUES_REPEAT, text, remedy, False, needs_action=False)


def refused(defects: Iterable[InputDefect], mapping: ColumnMapping) -> list[InputDefect]:
    """Return the errors that the mapping does not accept; they prevent estimates."""
    return [item for item in defects if item.is_error and item.kind not in mapping.accept]


def withholding(defects: Iterable[InputDefect], mapping: ColumnMapping) -> list[InputDefect]:
    """Return the certain errors that the mapping does not accept; live telemetry is withheld."""
    return [item for item in refused(defects, mapping) if item.is_certain]


def _other_drive(mapping: ColumnMapping, description: ActuatorDescription) -> Iterator[InputDefect]:
    current = mapping.measured_current
    if current is not None and current.kind == "i_q" and description.drive == "six_step":
        yield InputDefect(
            DefectKind.DRIVE_OF_I_Q,
            "the current is i_q of a field-oriented drive, but the description has drive six_step",
            "drive: field_oriented in the description, with k_t as torque per ampere of i_q, or "
            "current: {kind: equivalent}",
        )


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
    if not held:
        return
    rate_hz = 1e9 / max(float(np.median(np.diff(stamps_ns))), 1.0)
    parts = [
        f"the {item.column} repeats each value {item.longest} times (updated at "
        f"{rate_hz / item.longest:.4g} Hz)"
        if item.is_regular
        else f"the {item.column} is updated every {item.mean:.1f} samples on average, irregularly"
        for item in held
    ]
    remedy = "configure the driver to publish each value once, all at the same rate"
    if is_unknown:
        remedy = "it is used unchanged; configure the driver to publish each value once"
        if any(item.column == "position" for item in held):
            remedy = "records interpolate it between updates; configure the driver to publish each "
            remedy += "value once"
    yield InputDefect(
        DefectKind.VALUES_REPEAT,
        ", ".join(parts),
        remedy,
        not is_unknown,
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
        text = (
            f"the position jumps {counted(len(jumps), 'time')}, by up to {np.max(jumps):.4g} rad "
            "per sample"
        )
        remedy = "check whether the encoder is homed or reset, or two sources publish"
        yield InputDefect(DefectKind.POSITION_JUMPS, text, remedy)


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
    text = (
        f"the command is {command[is_beyond][0]:.4g} rad, far outside the travel from {low:.3g} to "
        f"{high:.3g} rad, in {counted(count, 'sample')} of {len(command)}"
    )
    remedy = "command: choose another source, or omit command"
    yield InputDefect(DefectKind.COMMAND_RANGE, text, remedy, is_certain=False)


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
        text = f"in all {counted(error.samples, 'sample')} while {error.moving} changes"
        if name == "current" and error.value == 0.0:
            text = f"current is 0 {text}: the drive does not publish it"
            remedy = "current: {sampling: none, ...}, or omit current"
            yield InputDefect(DefectKind.CURRENT_ZERO, text, remedy, is_certain=is_certain)
        else:
            remedy = f"{name}: choose another source"
            if name in ("current", "speed") or (name == "command" and is_unknown):
                remedy += f", or omit {name}"
            text = f"{name} is {error.value:g} {text}"
            yield InputDefect(
                kind_of_mistake(name, error.kind), text, remedy, is_certain=is_certain
            )
