# SPDX-License-Identifier: Apache-2.0
"""Position commands as sampled arrays, and test cycles built around them.

A command of ``n`` samples with period ``h`` contains the user-shaft angle [rad] at the times h,
2 h, ... n h; the angle at time 0 is zero. Models interpolate linearly between samples.
"""

import math
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.faults import BACKLASH, FAULTS, FRICTION, GAIN
from ema_core.parameters import ActuatorParameters, constants
from ema_core.quantity import Checked, check_length, finite_samples, hint_of_unit, quantity, text

COMMAND_SHAPES: Final = ("step", "ramp", "sine", "chirp", "swing", "moves", "custom")

APPROACH_DEPTH: Final = 2e-3
"""Default distance of the approach from below to the start of a cycle [rad]."""

_SLOWEST_MOVE = 0.1
_SHORTEST_MOVE_S = 0.05
_LONGEST_DWELL_S = 0.3
_APPROACH_SPEED = 5e-3
_RETREAT_S = 0.1
_HOLD_S = 0.1
_RETURN_S = 0.3
_ARRAYS = 2  # simultaneous arrays of the length of the command, without temporaries


@dataclass(frozen=True, eq=False)
class Command(Checked):
    """A position command, defined by its shape and parameters.

    A swing has the frequencies and envelope of a chirp but starts at rest. Its first half period
    moves from the start to the amplitude, each further half period between turning points. After a
    whole number of half periods it ends at rest.
    """

    shape: str = text("chirp", "shape of the command", COMMAND_SHAPES)
    amplitude: float = quantity(
        0.005,
        "rad",
        -10.0,
        10.0,
        "amplitude, height of the step, end value of the ramp, or limit of the moves",
    )
    duration: float = quantity(0.5, "s", 1e-3, 3600.0, "duration of the command")
    start_time: float = quantity(0.01, "s", 0.0, 3600.0, "start time of a step or ramp")
    rate: float = quantity(
        0.1, "rad/s", 0.0, 100.0, "speed of the ramp, or largest speed of the moves"
    )
    start_frequency: float = quantity(
        0.0, "Hz", 0.0, 1e3, "frequency of the sine, or of chirp or swing at its start"
    )
    end_frequency: float = quantity(15.0, "Hz", 0.0, 1e3, "frequency of chirp or swing at its end")
    final_fraction: float = quantity(
        1.0, "-", 0.0, 1.0, "ratio of final to initial amplitude of chirp or swing"
    )
    seed: int = quantity(0, "-", 0, 2**62, "seed of the moves")
    samples: ArrayLike = field(default=(), repr=False)
    """Samples of a custom command [rad]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shape == "moves" and self.rate == 0.0:
            raise ValueError("rate = 0 rad/s: expected a positive speed of the moves")
        if self.shape == "custom":
            object.__setattr__(
                self, "samples", finite_samples("shape = 'custom': samples", self.samples)
            )

    def travel_warning(self, parameters: ActuatorParameters) -> str:
        """Return a warning if the command exceeds the end stops, else "".

        It is not an error, because a test may drive the actuator into its stops on purpose. The
        usual cause is a wrong unit of the angle.
        """
        stop = parameters.theta_stop
        is_custom = self.shape == "custom"
        farthest = float(np.max(np.abs(self.samples))) if is_custom else abs(self.amplitude)
        if farthest <= stop:
            return ""
        name = "farthest sample" if is_custom else "amplitude"
        return (
            f"{name} = {farthest:g} rad is beyond the end stop, theta_stop = {stop:g} rad"
            + hint_of_unit(farthest, "rad", (1e-3, min(stop, 0.1)))
        )

    def sample(self, sample_period: float) -> NDArray[np.float64]:
        """Return the angles of the command [rad], ``(n,)``, sampled with a period [s].

        For a custom command, the result is a copy of its samples at any period.

        Raises
        ------
        ValueError
            If the period is not positive or longer than 10 ms, or there are too many samples.
        """
        if not 0.0 < sample_period <= 0.01:
            raise ValueError(f"sample_period = {sample_period!r} s is outside (0, 0.01] s")
        if self.shape == "custom":
            return np.array(self.samples)
        check_length(
            self.duration / sample_period,
            f"duration = {self.duration:g} s at sample_period = {sample_period:g} s",
            _ARRAYS,
        )
        n = max(1, round(self.duration / sample_period))
        t: NDArray[np.float64] = sample_period * np.arange(1.0, n + 1)
        if self.shape == "step":
            return np.where(t >= self.start_time - 1e-12, self.amplitude, 0.0)
        if self.shape == "ramp":
            travel = self.rate * np.maximum(t - self.start_time, 0.0)
            return np.copysign(np.minimum(travel, abs(self.amplitude)), self.amplitude)
        if self.shape == "moves":
            return self._moves(n, sample_period)
        f0 = self.start_frequency
        if self.shape == "sine":
            return self.amplitude * np.sin(2 * math.pi * f0 * t)
        f1, T = self.end_frequency, self.duration
        envelope = 1.0 - (1.0 - self.final_fraction) * t / T
        phase = 2 * math.pi * (f0 * t + (f1 - f0) * t**2 / (2 * T))
        if self.shape == "swing":
            swing = np.where(phase < math.pi, (1.0 - np.cos(phase)) / 2.0, -np.cos(phase))
            return self.amplitude * envelope * swing
        return self.amplitude * envelope * np.sin(phase)

    def _moves(self, n: int, h: float) -> NDArray[np.float64]:
        """Return the samples of smooth moves between random angles, with dwells, ``(n,)``."""
        rng = np.random.default_rng(self.seed)
        reach, parts, at, done = abs(self.amplitude), [], 0.0, 0
        while done < n:
            to = float(rng.uniform(-reach, reach))
            speed = rng.uniform(_SLOWEST_MOVE, 1.0) * self.rate
            lasts = max(math.pi / 2.0 * abs(to - at) / speed, _SHORTEST_MOVE_S)
            dwell = np.full(round(rng.uniform(0.0, _LONGEST_DWELL_S) / h), to)
            parts += [_smooth_move(at, to, lasts, h, n - done), dwell]
            at, done = to, done + len(parts[-2]) + len(dwell)
        return np.concatenate(parts)[:n]


THESIS_CHIRP: Final = Command()
"""Test command of the thesis: 5 mrad from 0 to 15 Hz in 0.5 s (table 7)."""


class CommandCycle(NamedTuple):
    """Samples of a whole test cycle [rad], and the position of the test command within them.

    ``start`` is the index of the last sample at rest before the command, ``stop`` the index after
    the last sample of the command.
    """

    samples: NDArray[np.float64]
    start: int
    stop: int


def _smooth_move(
    start: float, stop: float, duration: float, h: float, most: float = math.inf
) -> NDArray[np.float64]:
    """Return the first ``most`` samples of a move that starts and ends at rest, ``(n,)``."""
    n = max(1.0, round(duration / h) if duration / h < most else duration / h)
    u = np.arange(1, int(min(n, most)) + 1) / n
    return start + (stop - start) * (1.0 - np.cos(math.pi * u)) / 2.0


def approach_travel(parameters: ActuatorParameters) -> float:
    """Return the one-way command travel that takes up the play [rad].

    It is the sum of the largest backlash and the position error sustained by the highest friction
    at the lowest gain, both at the user shaft.
    """
    control, _, mechanics = constants(parameters)
    friction, backlash, gain = (FAULTS[i] for i in (FRICTION, BACKLASH, GAIN))
    stiffness = control.GAP * gain.at(0.0) * control.G_prop
    worst = friction.at(friction.highest) * mechanics.f_s
    held = worst / stiffness if stiffness > 0.0 else float("inf")
    widest = 2.0 * backlash.at(backlash.highest) * mechanics.half_backlash
    return widest * mechanics.tau + held


def approach_depth(parameters: ActuatorParameters) -> float:
    """Return the distance of the approach from below to the start of a cycle [rad].

    It is 2 mrad, or more if the play of the actuator requires it: then 1.2 times `approach_travel`,
    at most half the angle of the end stop.
    """
    return max(APPROACH_DEPTH, min(1.2 * approach_travel(parameters), parameters.theta_stop / 2.0))


def build_cycle(
    command: Command, sample_period: float, depth: float = APPROACH_DEPTH
) -> CommandCycle:
    """Return a test cycle: hold, approach from below, command, return, rest.

    The position of the user shaft does not show where the motor is within the backlash. After the
    slow approach from ``depth`` [rad] below, the gear is always in contact on the same side.

    Raises
    ------
    ValueError
        If the period is not positive or longer than 10 ms, or the cycle has too many samples.
    """
    h = sample_period
    check_length(
        depth / (_APPROACH_SPEED * h),
        f"an approach from {depth:g} rad below at {_APPROACH_SPEED:g} rad/s and sample_period = "
        f"{h:g} s",
        _ARRAYS,
    )
    proper = command.sample(h)
    hold = round(_HOLD_S / h)
    approach = np.linspace(-depth, 0.0, round(depth / (_APPROACH_SPEED * h)) + 1)[1:]
    before = np.concatenate(
        [
            np.zeros(hold),
            _smooth_move(0.0, -depth, _RETREAT_S, h),
            np.full(hold, -depth),
            approach,
            np.zeros(hold),
        ]
    )
    after = np.concatenate([_smooth_move(proper[-1], 0.0, _RETURN_S, h), np.zeros(hold)])
    return CommandCycle(
        np.concatenate([before, proper, after]), before.size - 1, before.size + proper.size
    )
