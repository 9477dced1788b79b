"""What is wrong with a mapping or with what it maps, named before anything is estimated."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.factors import explain
from ema_bags.inputs.mapping import CURRENTS, Mapping
from ema_bags.inputs.motion import ThinnedMotion
from ema_bags.inputs.resampling import Losses
from ema_core.description import ActuatorDescription
from ema_core.wording import counted

_LEAST_TRAVEL: Final = 1e-3
_RATIO_WITHIN: Final = 0.03
_CURRENT_SIZE: Final = 8.0
_MANY: Final = 0.01
_NAMES: Final = {"sign": "sign_reversed", "unit": "unit", "shaft": "shaft", "scale": "scale"}


@dataclass(frozen=True)
class InputDefect:
    """Something wrong.

    Attributes
    ----------
    name
        Its stable name, by which a mapping can accept it.
    text
        What is wrong, with values.
    remedy
        What to write in the mapping, or where else to look.
    is_error
        Whether estimates would be wrong; else it costs some data, or is worth knowing.
    """

    name: str
    text: str
    remedy: str
    is_error: bool = True

    def __str__(self) -> str:
        return f"{self.name}: {self.text}: {self.remedy}"


def find_defects(
    columns: dict[str, NDArray[np.float64]],
    stamps_ns: NDArray[np.int64],
    mapping: Mapping,
    description: ActuatorDescription,
) -> list[InputDefect]:
    """Return what is wrong with the columns of telemetry that a mapping gives.

    What needs motion to be told, as a sign or a unit, is only looked for where there is motion.

    Parameters
    ----------
    columns
        As of ``ema_bags.inputs.conversion.convert``, ``(n,)`` or empty.
    stamps_ns
        Stamps of the samples, ``(n,)`` [ns].
    """
    found = list(_other_drive(mapping, description))
    motion = ThinnedMotion.of(columns, stamps_ns, description.parameters.tau)
    if motion is None:
        return found
    found += _frozen(columns, motion)
    if not {"command_frozen", "position_frozen", "speed_frozen"} & {item.name for item in found}:
        found += _wrong_factors(motion, mapping, description)
    if not any(item.is_error for item in found):
        found += _wrong_current(motion, mapping, description)
    if mapping.position.shaft == "motor":
        text = "the position is measured at the motor, before the backlash"
        remedy = "backlash cannot be seen in it; an encoder at the user shaft shows it"
        found.append(InputDefect("position_at_motor", text, remedy, False))
    return found


def stream_defects(
    losses: Losses, rebuilt: int, *, of_table: bool = False
) -> Iterator[InputDefect]:
    """Yield what is wrong with the stamps and the completeness of samples.

    Parameters
    ----------
    of_table
        Whether they are rows of a table, which have no arrival.
    """
    n = max(losses.samples, 1)
    if losses.lost:
        text = (
            f"{counted(losses.lost, 'sample')} of {n + losses.lost} missing in "
            f"{counted(losses.gaps, 'place')}"
        )
        remedy = "no window spans a gap; fill_lost of the mapping fills short ones"
        yield InputDefect("lost_samples", text, remedy, False)
    if losses.filled:
        text = f"{counted(losses.filled, 'lost sample')} beside {n} put on a line (fill_lost)"
        remedy = "currents between samples are guessed: have the source lose fewer"
        yield InputDefect("filled_samples", text, remedy, False)
    if bad := losses.jumps + losses.repeated:
        text = (
            f"the time goes back {counted(losses.jumps, 'time')} and stands still "
            f"{counted(losses.repeated, 'time')} in {counted(n, 'sample')}"
        )
        remedy = "samples that repeat a stamp are left out, and no window spans a jump"
        if is_error := bad > _MANY * n:
            order = "Rows have to be in the order of time"
            rebuild = "clock: {source: arrival} rebuilds the stamps"
            remedy = f"is clock.source the right one? {order if of_table else rebuild}"
        yield InputDefect("time_not_monotonic", text, remedy, is_error)
    if rebuilt:
        text = f"{counted(rebuilt, 'stamp')} of {n} rebuilt from arrival"
        remedy = "have the source fill header.stamp, if it can"
        yield InputDefect("stamps_rebuilt", text, remedy, False)


def not_finite(columns: dict[str, NDArray[np.float64]]) -> Iterator[InputDefect]:
    """Yield which columns, as of ``find_defects``, have values that are not finite numbers."""
    bad = {name: ~np.isfinite(values) for name, values in columns.items() if len(values)}
    is_bad = np.any(list(bad.values()), axis=0)
    if not np.any(is_bad):
        return
    parts = [(name, int(np.count_nonzero(one))) for name, one in bad.items() if np.any(one)]
    text = ", ".join(f"{name} is not a finite number in {count}" for name, count in parts)
    remedy = "these samples are left out"
    if is_error := bool(np.mean(is_bad) > 0.5):
        name = max(parts, key=lambda item: item[1])[0]
        remedy = f"{name}: repair its source or choose another one"
        if name in ("current", "speed"):
            remedy += f", or leave {name} out if it is not measured"
    yield InputDefect("not_finite", f"{text} of {counted(len(is_bad), 'sample')}", remedy, is_error)


def refused(defects: Iterable[InputDefect], mapping: Mapping) -> list[InputDefect]:
    """Return the defects that forbid estimates: errors that the mapping does not accept."""
    return [item for item in defects if item.is_error and item.name not in mapping.accept]


def _other_drive(mapping: Mapping, description: ActuatorDescription) -> Iterator[InputDefect]:
    current = mapping.measured_current
    if current is not None and current.kind == "i_q" and description.drive == "six_step":
        yield InputDefect(
            "drive_of_i_q",
            "the current is i_q, which is of a field-oriented drive, and the description has drive "
            "six_step",
            "drive: field_oriented in the description, with k_t as torque per ampere of i_q, or "
            "current: {kind: equivalent}",
        )


def _frozen(
    columns: dict[str, NDArray[np.float64]], motion: ThinnedMotion
) -> Iterator[InputDefect]:
    moves = {name: motion.travel(name) > _LEAST_TRAVEL for name in ("command", "position")}
    moves["speed"] = motion.has_speed and motion.turned > _LEAST_TRAVEL
    for name in ("command", "position", "speed", "current"):
        values = columns[name]
        others = [other for other, moving in moves.items() if moving and other != name]
        # A blocked shaft stands still in position and speed alike, and is no defect of the data.
        if name in ("position", "speed") and not moves["position" if name == "speed" else "speed"]:
            continue
        finite = values[np.isfinite(values)]
        if not others or not len(finite) or np.ptp(finite) > 0.0:
            continue
        text = f"in all {counted(len(finite), 'sample')} while {others[0]} moves"
        if name == "current" and finite[0] == 0.0:
            text = f"current is 0 {text}: the drive does not publish it"
            remedy = "current: {sampling: none, ...}, or leave current out"
            yield InputDefect("current_zero", text, remedy)
        else:
            remedy = f"{name}: choose another source"
            if name in ("current", "speed"):
                remedy += f", or leave {name} out"
            yield InputDefect(f"{name}_frozen", f"{name} is {finite[0]:g} {text}", remedy)


def _wrong_factors(
    motion: ThinnedMotion, mapping: Mapping, description: ActuatorDescription
) -> Iterator[InputDefect]:
    """Yield units, signs and shafts that the relations of the columns contradict."""
    explained = explain(motion, mapping, description)
    if explained is not None:
        for change in explained:
            name = f"{change.quantity}_{_NAMES[change.entry]}"
            yield InputDefect(name, change.reason, change.remedy)
        return
    tau, ratio, gain = description.parameters.tau, motion.speed_ratio, motion.gain
    if ratio is not None and abs(ratio - 1.0) > _RATIO_WITHIN:
        yield InputDefect(
            "gear_ratio",
            f"position and speed give a gear ratio of {_as_ratio(tau * ratio)}, the "
            f"description has {_as_ratio(tau)}",
            f"parameters: {{tau: {tau * ratio:.6g}}} in the description, or speed: "
            f"{{scale: {ratio:.6g}}}",
        )
    if gain is not None and not 0.5 < gain < 2.0:
        yield InputDefect(
            "command_position",
            f"the position moves {gain:.3g} times as far as the command",
            f"command: {{scale: {gain:.6g}}} if both are of the same shaft, or choose another "
            "source",
        )


def _wrong_current(
    motion: ThinnedMotion, mapping: Mapping, description: ActuatorDescription
) -> Iterator[InputDefect]:
    """Yield a sign or size of the current that acceleration and friction contradict."""
    source = mapping.measured_current
    found = motion.current_against_torque(description.parameters)
    if source is None or found is None:
        return
    slope, correlation = found
    if correlation < -0.4:
        yield InputDefect(
            "current_sign_reversed",
            "the current is negative where the motor accelerates and drives friction in the "
            f"positive direction (correlation {correlation:.2f})",
            f"current: {{sign: {-source.sign}}}",
        )
        return
    # Inertia and friction of a drive of which nothing is known say nothing of the size.
    if correlation < 0.4 or description.drive == "unknown":
        return
    text = (
        f"the current is {slope:.3g} times as large as inertia and friction of the description need"
    )
    for factor in (1e3, 1e-3):
        if 1.0 / _CURRENT_SIZE < slope / factor < _CURRENT_SIZE:
            meant = f"m{source.unit}" if factor > 1.0 else source.unit.removeprefix("m")
            is_unit = meant in (*CURRENTS, "N.m", "mN.m") and meant != source.unit
            remedy = f"unit: {meant}" if is_unit else f"scale: {source.scale / factor:g}"
            yield InputDefect("current_unit", text, f"current: {{{remedy}}}")
            return
    if not 1.0 / 30.0 < slope < 30.0:
        remedy = (
            "is current.kind right (current or torque, motor or joint)? Are J_m, J_u and the "
            "friction of the description?"
        )
        yield InputDefect("current_size", text, remedy)


def _as_ratio(tau: float) -> str:
    return f"1/{1.0 / tau:.4g}" if tau and math.isfinite(tau) else f"{tau:g}"
