# SPDX-License-Identifier: Apache-2.0
"""An independent implementation of the monitor model in plain Python, from its equations.

The driven pair follows from the commutation of the reference, degree by degree, faults are given by
name, and only the table of parameters is shared with the kernels. A call of `step` computes
controller, drive, filter and mechanics in order, each from the results of the parts before it.
"""

import cmath
import math
from collections.abc import Callable, Mapping, Sequence

from ema_core.parameters import ActuatorParameters

from ..sim.reference_twin import PHASES, driven, move, saturate, sign


def eccentricity_4_24(zeta: float, phi: float, theta_e: float) -> float:
    """Return the factor of eq. 4.24; its sawtooth (4.25) rises from 0 to 2 six times per turn."""
    sawtooth = 2 * ((6 * theta_e - math.pi) / (2 * math.pi) % 1)
    wave = math.cos(theta_e + phi) + sawtooth * math.sin(theta_e - math.pi)
    return 1 - 0.42 * zeta * wave


class MonitorTwin:
    def __init__(
        self,
        actuator: ActuatorParameters,
        faults: Mapping[str, float],
        *,
        form: str,
        dt: float,
        command: float = 0.0,
        position: float = 0.0,
        speed: float = 0.0,
        current: float = 0.0,
        play: float = 0.0,
        contrast: float = 0.0,
        deviations: Mapping[str, float] | None = None,
    ) -> None:
        p = actuator
        d = dict(deviations or {})
        self.deviations = d
        self.actuator = p
        self.form = form
        self.dt = dt
        self.lift = d.get("lift", 0)
        self.contrast = contrast
        self.J = (p.J_m + p.J_u) * (1 + d.get("inertia", 0))
        self.C = (p.C_m + p.C_u) * (1 + d.get("viscous_friction", 0))
        dry = (p.f_sm + p.f_su) * (1 + d.get("friction", 0))
        self.f_s = dry * (1 + 2 * faults.get("friction", 0))
        self.f_d = self.f_s * p.f_ratio
        self.stribeck_speed = d.get("stribeck_speed", 0)
        self.loop_delay = d.get("loop_delay", 0)
        self.load = d.get("load_torque", 0)
        self.stiffness = d.get("load_stiffness", 0)
        self.play = p.BLK * (1 + 99 * faults.get("backlash", 0)) * (1 + d.get("backlash", 0))
        self.N = [
            (1 - faults.get(f"short_circuit_{phase}", 0)) * (1 + d.get(f"turns_{phase}", 0))
            for phase in "abc"
        ]
        fault = cmath.rect(
            faults.get("eccentricity", 0), (2 * faults.get("eccentricity_phase", 0.5) - 1) * math.pi
        )
        eccentricity = complex(d.get("eccentricity_cos", 0), d.get("eccentricity_sin", 0))
        self.zeta, self.phi = cmath.polar(fault + eccentricity)
        self.G_prop = p.G_prop * (0.5 + faults.get("gain", 0.5)) * (1 + d.get("loop_gain", 0))
        self.GAP = p.GAP * (1 + d.get("speed_loop", 0))
        magnets = 1 + d.get("torque_constant", 0)
        self.k_e, self.G_M = p.k_e * magnets, p.G_M * magnets
        # Copper.
        self.R_s = p.R_s * (1 + 0.00393 * d.get("winding_temperature", 0))
        self.V_max = p.V_max * (1 + d.get("supply_voltage", 0))

        self.theta_out = position / p.tau
        self.theta_m = self.theta_out + play * self.play / 2
        self.omega = speed
        self.torque = 0.0
        self.ripple = 0.0
        self.last_error = self._speed_error(command, position)
        # The integrator holds the part of the initial current that the error does not explain.
        self.integral = 0.0
        if p.GAI > 0:
            self.integral = (current * p.k_t - self.GAP * self.last_error) / p.GAI
        self.I = self._reference_current(self.last_error)
        self.lag = [self._equivalent_current()] * 3

    def samples(
        self, commands: Sequence[float], steps: int, watch: Callable[["MonitorTwin"], None]
    ) -> tuple[list[float], list[float]]:
        """Return the mean current of each sample and the speed at its end.

        The first command applies at the start. `watch` is called after every step.
        """
        means, speeds = [], []
        for k in range(1, len(commands)):
            total = 0.0
            for j in range(steps):
                self.step(commands[k - 1] + (commands[k] - commands[k - 1]) * (j - 0.5) / steps)
                watch(self)
                total += self.lag[2]
            means.append(total / steps)
            speeds.append(self.omega)
        period = steps * self.dt
        return self._sensed("current", means, period), self._sensed("speed", speeds, period)

    def _sensed(self, quantity: str, row: list[float], period: float) -> list[float]:
        """Return the readings of a sensor for a row: its interpolated values at an earlier time."""
        offset, gain, delay = (
            self.deviations.get(f"{quantity}_{name}", 0) for name in ("offset", "gain", "delay")
        )
        last = len(row) - 1
        seen = []
        for i in range(len(row)):
            at = max(i - delay / period, 0.0)
            before = min(int(at), last - 1)
            value = row[before] + (at - before) * (row[before + 1] - row[before])
            seen.append(value * (1 + gain) + offset)
        return seen

    def step(self, command: float) -> None:
        error = self._speed_error(command, self.theta_out * self.actuator.tau)
        I_ref = self._reference_current(error)
        self.integral += error * self.dt
        self.last_error = error
        # The motor position at the beginning of the step determines the driven pair.
        if self.form == "fast":
            self._fast_drive(I_ref)
        else:
            self._source_drive(I_ref)
        signal = self._equivalent_current()
        for n in range(3):
            self.lag[n] += (1 - math.exp(-self.dt / 1e-5)) * (signal - self.lag[n])
            signal = self.lag[n]
        self._mechanics()

    def _speed_error(self, command: float, position: float) -> float:
        return saturate(self.G_prop * (command - position), self.actuator.omega_max) - self.omega

    def _reference_current(self, error: float) -> float:
        p = self.actuator
        slope = (error - self.last_error) / self.dt
        torque = self.GAP * error + p.GAI * self.integral + p.GAD * slope
        return saturate(torque / p.k_t, p.I_max)

    def _commutation(self) -> list[int]:
        electrical = math.degrees(self.actuator.P * self.theta_m)
        return [driven(electrical - 120 * n) for n in PHASES]

    def _equivalent_current(self) -> float:
        if self.form == "source":
            return self.I
        s = self._commutation()
        idle = self.N[s.index(0)]
        driven_pair = (sum(self.N) - idle) / 2
        lift = self.lift * (1 + self.contrast * (driven_pair - idle))
        return self.I + lift * saturate(self.I / self.actuator.h_b, 1)

    def _fast_drive(self, I_ref: float) -> None:
        p = self.actuator
        s = self._commutation()
        # Outside the plateaus of the driven phases, the shape of the back-EMF has the sign of the
        # current.
        k = [
            self.k_e
            / 2
            * self.N[n]
            * s[n]
            * (1 + self.zeta * math.cos(self.theta_m + self.phi + 2 * math.pi * n / 3))
            for n in PHASES
        ]
        R = sum(self.R_s / 2 * self.N[n] for n in PHASES if s[n])
        L = sum(p.L_s / 2 * self.N[n] ** 2 for n in PHASES if s[n])
        K = k[s.index(1)] - k[s.index(-1)]
        drop = (R * self.I + K * self.omega) / L
        delayed = I_ref - self.loop_delay * drop
        highest = (self.V_max - R * self.I - K * self.omega) / L * self.dt
        lowest = (-self.V_max - R * self.I - K * self.omega) / L * self.dt
        self.I += sorted((lowest, delayed - self.I, highest))[1]
        self.torque = saturate(K * self.I, p.T_max)
        self.ripple = K * (p.h_b + self.loop_delay * self.V_max / L)

    def _source_drive(self, I_ref: float) -> None:
        p = self.actuator
        s = self._commutation()
        f = sum(self.N[n] for n in PHASES if s[n]) / 2
        K = f * eccentricity_4_24(self.zeta, self.phi, p.P * self.theta_m)
        R = self.R_s * f
        time_constant = p.L_s * sum(N**2 for N in self.N) / 3 / R
        voltage = self.V_max * sign(I_ref - self.I) - self.k_e * K * self.omega
        self.I += (voltage / R - self.I) / time_constant * self.dt
        self.torque = saturate(self.G_M * K * self.I, p.T_max)

    def _mechanics(self) -> None:
        # The load moves with the user shaft, after the play.
        T = self.torque - self.load - self.stiffness * self.theta_out * self.actuator.tau
        # The ripple keeps a motor at rest in motion at about 0.1 rad/s.
        square = self.stribeck_speed**2
        slowness = square / (square + self.omega**2 + 0.1**2)
        f_d = self.f_d + (self.f_s - self.f_d) * slowness**2
        if self.omega == 0:
            holds = abs(T) <= max(self.f_s - self.ripple, f_d)
            friction = T if holds else f_d * sign(T)
        else:
            friction = f_d * sign(self.omega)
        omega = self.omega + (T - self.C * self.omega - friction) / self.J * self.dt
        move(self, omega)
