# SPDX-License-Identifier: Apache-2.0
"""A rigid joint on a prescribed motion, so that the truth is exact, and its records."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.acquisition import Acquisition
from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.joint.record import NS_A_DAY
from ema_monitor.windows.window import Window

Column = NDArray[np.float64]

H = 0.01
FIRST_DAY = 19_000
"""Day of the first healthy records, counted from 1970."""


class Motion(NamedTuple):
    """Time [s], position [rad], speed [rad/s] and acceleration [rad/s^2], ``(n,)`` each."""

    time: Column
    q: Column
    v: Column
    a: Column


@dataclass(frozen=True)
class Joint:
    """True parameters of a joint, referred to the motor, where the effort is measured.

    Attributes
    ----------
    inertia, coulomb, viscous, gravity, load
        Coefficients of ``a``, ``sign(v)``, ``v``, ``sin(q)`` and 1 [A.s^2/rad, A, A.s/rad, A, A].
    stribeck, stribeck_speed
        Additional friction at rest [A], and the speed over which it decays [rad/s].
    ripple, ripple_waves
        Amplitude of a ripple along the position [A], and its wave number [1/rad].
    resonance_hz
        Resonance of the gear between motor and load, with half of the inertia on each side [Hz].
        Position and gravity refer to the load, friction to the motor.
    torque
        Torque per ampere, relative to the healthy value [-].
    play, wind_up
        Lost motion between motor and joint, and wind-up of the gear per 1 A of friction [rad].
    """

    inertia: float = 0.12
    coulomb: float = 1.0
    viscous: float = 0.25
    gravity: float = 0.0
    load: float = 0.1
    stribeck: float = 0.0
    stribeck_speed: float = 0.2
    ripple: float = 0.0
    ripple_waves: float = 3.0
    resonance_hz: float = np.inf
    load_share: float = 0.0
    torque: float = 1.0
    play: float = 0.0
    wind_up: float = 0.0

    def effort(self, motion: Motion) -> Column:
        """Return the effort [A], ``(n,)``."""
        h = motion.time[1] - motion.time[0]
        jerk = np.gradient(motion.a, h)
        of_resonance = (2.0 * np.pi * self.resonance_hz) ** -2.0
        v = motion.v + 2.0 * of_resonance * jerk
        dip = self.stribeck * np.exp(-((v / self.stribeck_speed) ** 2))
        transmitted = self.inertia * motion.a + self.gravity * np.sin(motion.q)
        torque = (
            self.inertia * (motion.a + of_resonance * np.gradient(jerk, h))
            + (self.coulomb + dip + self.load_share * np.abs(transmitted)) * np.sign(v)
            + self.viscous * v
            + self.gravity * np.sin(motion.q)
            + self.ripple * np.sin(2.0 * np.pi * self.ripple_waves * motion.q)
            + self.load
        )
        return torque / self.torque

    def times(self, **factors: float) -> "Joint":
        """Return the joint with some of its parameters multiplied."""
        return replace(self, **{name: getattr(self, name) * by for name, by in factors.items()})


@dataclass(frozen=True)
class Sensors:
    """Sensors with which a record is measured.

    Attributes
    ----------
    noise
        Noise of the effort [A].
    position_noise, step
        Noise and resolution of the position [rad].
    lag_s
        Delay of the effort [s].
    outliers
        Share of samples of the effort that are off by ten times the Coulomb friction.
    speed, command
        Whether the speed is measured, and whether there is a command.
    tracking_lag
        Delay of the position behind the command [s].
    """

    noise: float = 0.05
    position_noise: float = 0.0
    step: float = 0.0
    lag_s: float = 0.0
    outliers: float = 0.0
    speed: bool = False
    command: bool = True
    tracking_lag: float = 0.02


EXACT = Sensors(noise=0.0)


def tones(
    duration_s: float = 40.0, h: float = H, *, speed: float = 1.0, size: float = 1.0
) -> Motion:
    """Return motion in two tones, back and forth at many speeds and accelerations.

    ``speed`` multiplies the frequencies, ``size`` the amplitudes.
    """
    t = _times(duration_s, h)
    q, v, a = np.zeros((3, len(t)))
    for amplitude, hertz in ((0.8, 0.31), (0.4, 0.83)):
        omega = 2.0 * np.pi * hertz * speed
        q += size * amplitude * np.sin(omega * t)
        v += size * amplitude * omega * np.cos(omega * t)
        a -= size * amplitude * omega**2 * np.sin(omega * t)
    return Motion(t, q, v, a)


def _times(duration_s: float, h: float) -> Column:
    return np.array(h * np.arange(round(duration_s / h)), dtype=np.float64)


def ramps(duration_s: float = 40.0, h: float = H, *, speed: float = 0.5) -> Motion:
    """Return strokes of 2 s at one speed [rad/s], with reversals of 0.1 s: no acceleration."""
    t = _times(duration_s, h)
    phase = np.abs((t % 4.0) - 2.0) - 1.0  # 1 to -1 to 1
    v = speed * np.clip(np.where(t % 4.0 < 2.0, 1.0, -1.0) * (1.0 - np.abs(phase)) / 0.05, -1, 1)
    q = h * np.cumsum(v)
    return Motion(t, q, v, np.gradient(v, h))


def places(duration_s: float = 40.0, h: float = H, *, seed: int = 0) -> Motion:
    """Return strokes of 0.5 to 1 s to random positions, with minimum jerk and rests of 0.2 s."""
    rng = np.random.default_rng(seed)
    t = _times(duration_s, h)
    q, v, a = np.zeros((3, len(t)))
    begin, place = 0.0, 0.0
    while begin < duration_s:
        length, target = float(rng.uniform(0.5, 1.0)), float(rng.uniform(-1.0, 1.0))
        s, way = np.clip((t - begin) / length, 0.0, 1.0), target - place
        q += way * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        v += way / length * 30.0 * s**2 * (1.0 - s) ** 2
        a += way / length**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
        begin, place = begin + length + 0.2, target
    return Motion(t, q, v, a)


def telemetry_of(
    joint: Joint, motion: Motion, sensors: Sensors, *, seed: int = 0, day: int = 0, second: int = 0
) -> Telemetry:
    """Return the telemetry of a motion on a day."""
    rng = np.random.default_rng((seed, day, second))
    h = float(motion.time[1] - motion.time[0])
    n = len(motion.time)
    effort = joint.effort(motion)
    if sensors.lag_s:
        effort = np.interp(motion.time - sensors.lag_s, motion.time, effort)
    effort = effort + sensors.noise * rng.standard_normal(n)
    wrong = rng.random(n) < sensors.outliers
    effort[wrong] += 10.0 * joint.coulomb * rng.choice([-1.0, 1.0], int(np.sum(wrong)))
    lost = joint.play + joint.wind_up * joint.coulomb
    position = motion.q - 0.5 * lost * np.sign(motion.v)
    position = position + sensors.position_noise * rng.standard_normal(n)
    if sensors.step:
        position = sensors.step * np.round(position / sensors.step)
    command = motion.q + sensors.tracking_lag * motion.v
    stamp_ns = (FIRST_DAY + day) * NS_A_DAY + second * 1_000_000_000
    return Telemetry(
        stamp_ns,
        h,
        0,
        command if sensors.command else np.empty(0),
        effort,
        position,
        motion.v.copy() if sensors.speed else np.empty(0),
    )


def described(
    sensors: Sensors | None = None, h: float = H, *, lead: float = 0.0, k_t: float = 1.0
) -> ActuatorDescription:
    """Return the description of a joint, whose motor and user shaft are identical."""
    sensors = sensors or Sensors()
    return ActuatorDescription(
        actuator_id="joint",
        serial_number="J1",
        sample_period=h,
        parameters=ActuatorParameters(tau=1.0, k_t=k_t, lead=lead),
        drive="unknown",
        # The current at the end of a sample, so that no lag is known.
        acquisition=Acquisition(
            current="instantaneous", speed=sensors.speed, command=sensors.command
        ),
    )


def healthy_telemetry(
    joint: Joint | None = None,
    sensors: Sensors | None = None,
    motion: Motion | None = None,
    *,
    days: int = 3,
    a_day: int = 3,
    scatter: float = 0.01,
    seed: int = 0,
) -> list[Telemetry]:
    """Return healthy records; friction scatters between days, and half as much within a day."""
    joint, sensors = joint or Joint(), sensors or Sensors()
    motion = tones() if motion is None else motion
    rng = np.random.default_rng(seed)
    records = []
    for day in range(days):
        of_day = scatter * rng.standard_normal()
        for number in range(a_day):
            factor = 1.0 + of_day + 0.5 * scatter * rng.standard_normal()
            scaled = joint.times(coulomb=factor, viscous=factor)
            records.append(
                telemetry_of(scaled, motion, sensors, seed=seed + 1, day=day, second=100 * number)
            )
    return records


def window_of(telemetry: Telemetry, *, temperature: float | None = None) -> Window:
    """Return a record as a window, with a measured rise of the winding temperature [K]."""
    measured: Sequence[CauseEstimate] = ()
    if temperature is not None:
        measured = [CauseEstimate("winding_temperature", temperature, 0.5)]
    return Window(telemetry, measured=tuple(measured))
