# SPDX-License-Identifier: Apache-2.0
"""An independent implementation of the reference actuator in plain Python, from its equations.

Commutation angles are in degrees, faults and hidden causes are given by name, and only the table of
parameters is shared with the kernels. A call of `step` computes the six parts of a step in order,
each from the results of the parts before it.
"""

import math
from collections.abc import Mapping
from typing import Any

from ema_core.causes import CAUSE_BY_NAME
from ema_core.parameters import ActuatorParameters

PHASES = (0, 1, 2)
MULTIPLE = {
    "friction": 0.3,
    "backlash": 0.02,
    "short_circuit_a": 0.1,
    "short_circuit_b": 0.25,
    "eccentricity": 0.4,
    "eccentricity_phase": 0.1,
    "gain": 0.8,
}


def sign(x: float) -> int:
    return (x > 0) - (x < 0)


def saturate(x: float, limit: float) -> float:
    return math.copysign(limit, x) if abs(x) > limit else x


def driven(degrees: float) -> int:
    """Return the sign of the current in a phase at its electrical angle [deg]."""
    degrees %= 360
    if 30 < degrees < 150:
        return 1
    if 210 < degrees < 330:
        return -1
    return 0


def back_emf_shape(degrees: float) -> float:
    """Return the trapezoid: +1 or -1 where the phase is driven, and linear in between."""
    degrees %= 360
    if degrees < 30:
        return degrees / 30
    if degrees <= 150:
        return 1
    if degrees < 210:
        return (180 - degrees) / 30
    if degrees <= 330:
        return -1
    return (degrees - 360) / 30


def move(twin: Any, omega: float) -> None:
    """Move the part between the end stops, which drives an output through its play."""
    if sign(omega) == -sign(twin.omega):
        omega = 0.0
    twin.omega = omega
    twin.theta_m += omega * twin.dt
    stop = twin.actuator.theta_stop / twin.actuator.tau
    if abs(twin.theta_m) > stop:
        twin.theta_m = stop * sign(twin.theta_m)
        twin.omega = 0.0
    if twin.theta_m - twin.theta_out > twin.play / 2:
        twin.theta_out = twin.theta_m - twin.play / 2
    elif twin.theta_out - twin.theta_m > twin.play / 2:
        twin.theta_out = twin.theta_m + twin.play / 2


class ReferenceTwin:
    dt = 1e-6

    def __init__(self, actuator: ActuatorParameters, faults: Mapping[str, float]) -> None:
        p = actuator
        self.cause = dict.fromkeys(CAUSE_BY_NAME, 0.0)
        self.time = 0.0
        self.dead = [0.0, 0.0, 0.0]
        self.actuator = p
        self.theta_m = self.omega = self.theta_out = 0.0
        self.i = [0.0, 0.0, 0.0]
        self.q = [1, 1, 1]
        self.lag = [0.0, 0.0, 0.0]
        self.integral = 0.0
        self.last_error = 0.0
        self.torque = 0.0

        self.f_s = (p.f_sm + p.f_su) * (1 + 2 * faults.get("friction", 0))
        self.f_d = self.f_s * p.f_ratio
        self.play = p.BLK * (1 + 99 * faults.get("backlash", 0))
        self.N = [1 - faults.get(f"short_circuit_{phase}", 0) for phase in "abc"]
        self.zeta = faults.get("eccentricity", 0)
        self.phi = (2 * faults.get("eccentricity_phase", 0.5) - 1) * math.pi
        self.g = 0.5 + faults.get("gain", 0.5)

    @property
    def theta_user(self) -> float:
        return self.theta_out * self.actuator.tau

    def step(self, command: float, noise: float = 0.0, load: float = 0.0) -> None:
        I_ref = self._control(command, noise)
        electrical = [math.degrees(self.actuator.P * self.theta_m) - 120 * n for n in PHASES]
        self._switch([I_ref * driven(angle) for angle in electrical])
        k = [self._back_emf_constant(n, electrical[n]) for n in PHASES]
        self._stator(k)
        self._torque_and_lags(k)
        self._mechanics(load + self._hidden_load())
        self.time += self.dt

    def _control(self, command: float, noise: float) -> float:
        p = self.actuator
        omega_ref = saturate(p.G_prop * self.g * (command - self.theta_user), p.omega_max)
        error = omega_ref - self.omega
        torque_ref = (
            p.GAP * error + p.GAI * self.integral + p.GAD * (error - self.last_error) / self.dt
        )
        self.integral += error * self.dt
        self.last_error = error
        return saturate(torque_ref / p.k_t + noise, p.I_max)

    def _switch(self, targets: list[float]) -> None:
        for n in PHASES:
            before = self.q[n]
            if self.i[n] - targets[n] > self.actuator.h_b:
                self.q[n] = -1
            elif self.i[n] - targets[n] < -self.actuator.h_b:
                self.q[n] = 1
            if self.q[n] != before:
                self.dead[n] = self.cause["dead_time"]

    def _back_emf_constant(self, n: int, electrical: float) -> float:
        gap = 1 + self.zeta * math.cos(self.theta_m + self.phi + 2 * math.pi * n / 3)
        k_e = self.actuator.k_e * (1 + self.cause["torque_constant"])
        return k_e / 2 * self.N[n] * back_emf_shape(electrical) * gap

    def _stator(self, k: list[float]) -> None:
        p = self.actuator
        warmth = 1 + 0.00393 * self.cause["winding_temperature"]
        R = [p.R_s * warmth / 2 * N for N in self.N]
        L = [p.L_s / 2 * N**2 for N in self.N]
        ripple = self.cause["supply_ripple"] * math.sin(2 * math.pi * 2400 * self.time)
        rail = p.V_max * (1 + self.cause["supply_voltage"]) / 2 * (1 + ripple)
        emf = [k[n] * self.omega for n in PHASES]
        share = [min(self.dead[n] / self.dt, 1.0) if self.dead[n] > 1e-12 else 0 for n in PHASES]
        self.dead = [self.dead[n] - self.dt for n in PHASES]
        if self.cause["dead_switch"] and self.q[0] == 1:
            share[0] = 1
        off = [share[n] > 1 - 1e-6 for n in PHASES]
        whole = {n for n in PHASES if not self.cause[f"open_phase_{'abc'[n]}"]}
        driven_by = {n: rail * (1 - share[n]) * self.q[n] for n in whole}
        for n in whole:
            driven_by[n] -= rail * share[n] * sign(self.i[n])
        wired = {n for n in whole if not off[n] or self.i[n] != 0}

        def centre(phases: set[int]) -> float:
            u = {n: driven_by[n] - R[n] * self.i[n] - emf[n] for n in phases}
            return sum(u[n] / L[n] for n in phases) / max(sum(1 / L[n] for n in phases), 1e-9)

        floating_centre = centre(wired)
        for n in whole - wired:
            terminal = floating_centre + emf[n]
            if abs(terminal) > rail:
                driven_by[n] = rail * sign(terminal)
                wired = wired | {n}
        star = centre(wired)
        currents = list(self.i)
        for n in wired:
            u = driven_by[n] - R[n] * self.i[n] - emf[n]
            currents[n] += (u - star) / L[n] * self.dt
        blocked = {n for n in wired if off[n] and currents[n] * driven_by[n] > 0}
        blocked |= set(PHASES) - whole
        for n in blocked:
            currents[n] = 0.0
        # The flux of the loop that is left persists.
        left = wired - blocked
        excess = sum(currents)
        for n in left:
            currents[n] -= excess / L[n] / sum(1 / L[m] for m in left)
        self.i = currents

    def _torque_and_lags(self, k: list[float]) -> None:
        torque = sum(k[n] * self.i[n] for n in PHASES)
        self.torque = saturate(torque, self.actuator.T_max)
        signal = sign(self.torque) * sum(abs(i) for i in self.i) / 2
        for n in range(3):
            self.lag[n] += (1 - math.exp(-self.dt / 1e-5)) * (signal - self.lag[n])
            signal = self.lag[n]

    def _hidden_load(self) -> float:
        cogging = self.cause["cogging"] * math.sin(6 * self.actuator.P * self.theta_m)
        spring = self.cause["load_stiffness"] * self.theta_user
        return self.cause["load_torque"] + spring + cogging

    def _dry_friction(self) -> tuple[float, float]:
        """Return breakaway and dynamic friction [N.m]."""
        rough = 1 + self.cause["friction_ripple"] * math.sin(self.theta_m)
        slow = math.exp(-abs(self.omega) / 10)
        f_d = self.f_d * (1 + self.cause["stribeck"] * slow) * rough
        return max(self.f_s * rough, f_d), f_d

    def _mechanics(self, load: float) -> None:
        if self.cause["jam"]:
            self.omega = 0.0
            return
        p = self.actuator
        J = (p.J_m + p.J_u) * (1 + self.cause["inertia"])
        C = (p.C_m + p.C_u) * (1 + self.cause["viscous_friction"])
        T = self.torque - load
        f_s, f_d = self._dry_friction()
        if self.omega == 0:
            friction = T if abs(T) <= f_s else f_d * sign(T)
        else:
            friction = f_d * sign(self.omega)
        omega = self.omega + (T - C * self.omega - friction) / J * self.dt
        move(self, omega)
