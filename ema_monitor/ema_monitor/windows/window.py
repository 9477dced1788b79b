# SPDX-License-Identifier: Apache-2.0
"""Window of telemetry, which is the input of one diagnosis."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ema_core.arrays import Array, Flags
from ema_core.causes import CauseEstimate
from ema_core.display import Displayed
from ema_core.telemetry import Telemetry
from ema_monitor.reasons import MotorStill, NoTravel, Reason

MIN_TRAVEL: Final = 1e-3
"""Smallest peak-to-peak range of the command that excites the faults [rad]."""


DWELL_S: Final = 0.02
"""Shortest rest of the command that counts as a dwell [s]."""

SMOOTHED_S: Final = 4e-3
"""Averaging time of the speed in the weights of samples [s]."""

_REST: Final = 2e-4
_INITIAL_S: Final = 1e-3


@dataclass(frozen=True, repr=False)
class Window(Displayed):
    """Telemetry of one test, from the last sample at rest (the initial state) to the end.

    The window of an unknown drive is a record: seconds to minutes of motion, with a margin of rest.
    """

    telemetry: Telemetry
    """``n + 1`` samples without a gap, except for rests of a record (``omitted``); the first sample
    is the start."""
    play: float | None = None
    """Position of the motor in its play at the start [half-widths, -1 to 1]; None if unknown."""
    measured: tuple[CauseEstimate, ...] = ()
    """Measured hidden causes, as `measured_causes` returns them."""
    is_remainder: bool = False
    """Whether the window is a short record that continues the motion of the record before it."""
    omitted: tuple[range, ...] = ()
    """Long rests within a record that its telemetry leaves out: ranges of running indices, in
    ascending order."""

    def __len__(self) -> int:
        return len(self.telemetry) - 1

    def without_date(self) -> "Window":
        """Return the window with timestamps that begin at 0, as from a drive without a clock."""
        return replace(self, telemetry=replace(self.telemetry, stamp_ns=0))

    @property
    def brief(self) -> str:
        """Phrase with the length, sample rate, excitation and start."""
        seconds = len(self) * self.sample_period
        return (
            f"{seconds:.4g} s, {len(self)} samples at {1.0 / self.sample_period:.6g} Hz, travel "
            f"{1e3 * self.excitation:.3g} mrad, from stamp {self.start_ns} ns"
        )

    def __str__(self) -> str:
        return (
            f"window of {len(self)} samples every {self.sample_period:g} s from stamp "
            f"{self.start_ns} ns, the {'command' if len(self.command) else 'position'} travels "
            f"{1e3 * self.excitation:.1f} mrad"
        )

    @property
    def command(self) -> Array:
        """Command, including the command at the start, ``(n + 1,)`` [rad]."""
        return self.telemetry.command

    @property
    def current(self) -> Array:
        """Measured equivalent current after the start, ``(n,)`` [A]; empty if not measured."""
        return self.telemetry.current[1:]

    @property
    def initial_current(self) -> float:
        """Measured current at the start [A]; 0 if it is not measured."""
        return float(self.telemetry.current[0]) if len(self.telemetry.current) else 0.0

    def speed(self, tau: float) -> Array:
        """Return the speed after the start, ``(n,)`` [rad/s], for a gear ratio ``tau``.

        It is the motor speed at the end of each sample. If the speed is not measured, it is the
        mean speed of the fast shaft behind the play over each sample, from position and gear ratio.
        """
        if len(self.telemetry.speed):
            return self.telemetry.speed[1:]
        return np.diff(self.telemetry.position) / (tau * self.sample_period)

    def initial_speed(self, tau: float) -> float:
        """Return the motor speed at the start [rad/s], measured or derived from the position."""
        if len(self.telemetry.speed):
            return float(self.telemetry.speed[0])
        n = min(max(2, round(_INITIAL_S / self.sample_period)), len(self))
        return float(np.mean(self.speed(tau)[:n]))

    def missed(self, current: Array, speed: Array, tau: float) -> Array:
        """Return measured minus modelled current and speed, ``(2, ..., n)`` [A, rad/s].

        If the current is not measured, its residuals are 0.

        Parameters
        ----------
        current, speed
            Response of a model, ``(..., n)`` each [A, rad/s].
        tau
            Gear ratio [-].
        """
        residuals = self.current - current if len(self.current) else np.zeros_like(current)
        return np.stack([residuals, self.speed(tau) - speed])

    @property
    def sample_period(self) -> float:
        """Sample period [s]."""
        return self.telemetry.sample_period

    @property
    def start_ns(self) -> int:
        """Timestamp of the start [ns]."""
        return self.telemetry.stamp_ns

    @property
    def end_ns(self) -> int:
        """Timestamp of the last sample [ns]."""
        return self.telemetry.stamp_at(self.span - 1)

    @property
    def span(self) -> int:
        """Number of samples from the first to the last, including omitted samples."""
        return len(self.telemetry) + sum(map(len, self.omitted))

    @property
    def start_offset(self) -> float:
        """Position minus command at the start [rad]; at rest, friction causes a small offset."""
        return float(self.telemetry.position[0] - self.command[0])

    @property
    def excitation(self) -> float:
        """Peak-to-peak range of the command, or of the position without a command [rad]."""
        telemetry = self.telemetry
        return float(np.ptp(self.command if len(self.command) else telemetry.position))

    @property
    def moves(self) -> Flags:
        """Flags of the samples after the start at which the command moves, ``(n,)``.

        While the command dwells, static friction holds the shaft, so that no model can predict the
        current.
        """
        n = min(max(1, round(DWELL_S / self.sample_period)), len(self))
        rests = np.ptp(sliding_window_view(self.command, n + 1), axis=1) <= _REST * self.excitation
        return np.convolve(rests, np.ones(n + 1))[1:] < 0.5

    @property
    def weights(self) -> Array:
        """Sample weights, which are small at low speed and 0 in dwells, ``(n,)`` [-].

        The weights are ``|omega| / hypot(|omega|, omega_rms / 2)`` with the speed averaged over
        ``SMOOTHED_S``, or 0 while the command dwells. They are scaled to a mean square of 1.
        """
        speed = self.speed(1.0)  # the scale has no effect
        n = max(1, round(SMOOTHED_S / self.sample_period))
        smooth = np.convolve(np.abs(speed), np.ones(n) / n, mode="same")
        slow = 0.5 * math.sqrt(float(np.mean(speed**2)))
        weights = self.moves * smooth / np.hypot(smooth, max(slow, 1e-12))
        return weights / max(math.sqrt(float(np.mean(weights**2))), 1e-12)

    def excitation_defect(self) -> Reason | None:
        """Return the reason why the window does not excite the faults, or None."""
        travel = self.excitation
        if travel < MIN_TRAVEL:
            return NoTravel(travel, MIN_TRAVEL)
        return None if np.any(self.speed(1.0)) else MotorStill()
