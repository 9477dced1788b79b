# SPDX-License-Identifier: Apache-2.0
"""Wording of doubts about a recognised mapping."""

from collections.abc import Callable
from typing import Final

from ema_bags.inputs.change_wording import change_reason
from ema_bags.inputs.doubts import Doubt, DoubtKind

_WORDS: Final[dict[DoubtKind, Callable[[Doubt], str]]] = {
    DoubtKind.NO_MOTION: lambda _: (
        "the columns could not be identified from the motion, only from their names"
    ),
    DoubtKind.NAME_ALONE: lambda d: f"{d.quantity} {d.column!r} is a guess from its name alone",
    DoubtKind.VALUES_ALONE: lambda d: f"{d.quantity} {d.column!r} is a guess from its values alone",
    DoubtKind.ALTERNATIVES: lambda d: (
        f"{d.quantity} {d.column!r} is a guess; alternatives: {', '.join(map(repr, d.names))}"
    ),
    DoubtKind.SET_POINT: lambda d: (
        f"{d.quantity} {d.column!r} is a setpoint according to its name: map the measured "
        f"{d.quantity}, if there is one"
    ),
    DoubtKind.FROM_ERROR: lambda d: f"position is {d.column}: the error is command minus position",
    DoubtKind.NO_COMMAND: lambda _: "no command was recognized: tracking is not assessed",
    DoubtKind.NOT_FOUND: lambda d: (
        f"no column was recognized as {d.quantity}: it is assumed not to be measured"
    ),
    DoubtKind.CONSTANT: lambda d: f"{d.quantity} never changes: it is assumed not to be measured",
    DoubtKind.UNIT_GUESSED: lambda d: (
        f"{d.quantity}.unit is a guess: the name {d.column!r} has no unit"
    ),
    DoubtKind.EFFORT_KIND: lambda _: (
        "effort may be a current, a motor torque, a joint torque, or unused: confirm kind"
    ),
    DoubtKind.LEAD_GUESSED: lambda d: (
        f"{d.quantity}.lead {d.value:g} m is a guess: enter the travel per shaft turn"
    ),
    DoubtKind.ELEMENT_GUESSED: lambda d: f"{d.quantity}.source {d.column} is a guess",
    DoubtKind.ENCODING: lambda d: (
        f"{d.quantity}.encoding {d.entry}: its values are from a signed register read as unsigned"
    ),
    DoubtKind.MAGNITUDE: lambda _: (
        "current.kind magnitude: the current is never negative; confirm that no load keeps it "
        "above 0"
    ),
    DoubtKind.CHANGED: lambda d: (
        f"{d.quantity}.{d.entry}: {change_reason(d.change) if d.change else ''}"
    ),
    DoubtKind.FEW_SAMPLES: lambda _: "too few samples to compare the columns",
    DoubtKind.SIGN_UNCHECKED: lambda _: "the sign and unit of the current cannot be checked",
    DoubtKind.SIGN_REVERSED: lambda d: (
        f"current.sign {d.value:g}: with the opposite sign, it would oppose the acceleration"
    ),
    DoubtKind.JOINT_TORQUE: lambda _: "current.kind joint_torque: too large for a motor torque",
    DoubtKind.EFFORT_SIZE: lambda d: (
        f"the current is {d.value:.3g} times what the described inertia and friction require: is "
        "it a torque?"
    ),
    DoubtKind.SAMPLING_UNKNOWN: lambda _: (
        "current.sampling cannot be inferred from the data: choose mean, filtered or instantaneous"
    ),
    DoubtKind.PHASE_CURRENTS: lambda d: (
        f"phase currents {', '.join(d.names)}: map them as current: {{kind: phase_currents, "
        f"phases: [{', '.join(d.names)}], torque_sign: COLUMN}}, where COLUMN has the sign of the "
        "torque"
    ),
    DoubtKind.WINDING: lambda d: (
        f"{d.column!r} may be the winding temperature: if so, map it as temperature"
    ),
    DoubtKind.CLOCK_UNIT: lambda d: f"clock.unit {d.entry} is inferred from the values or steps",
    DoubtKind.NO_CLOCK: lambda d: (
        f"no column was recognized as the time: set clock.rate_hz; {d.value:g} is a guess"
    ),
    DoubtKind.NO_NUMBERS: lambda d: f"column {d.column!r} contains no numbers",
}


def doubt_text(doubt: Doubt) -> str:
    """Return the text of a doubt, without capital and full stop."""
    return _WORDS[doubt.kind](doubt)
