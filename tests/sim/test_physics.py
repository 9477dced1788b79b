# SPDX-License-Identifier: Apache-2.0
"""Closed forms and invariants of the reference actuator: shaft, stator, energy, symmetry."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, PlantConstants, constants
from ema_sim.actuator import at_rest
from ema_sim.reference import DT

from .reference_twin import driven
from .trajectories import locked, run, unpowered

ACTUATOR = ActuatorParameters()
PLANT = constants(ACTUATOR)
COASTING = unpowered(PLANT)
# Enough damping to matter next to the dry friction: 0.1 N.m at the start, against 0.08 N.m.
DAMPED = unpowered(constants(ActuatorParameters(C_m=0.01)))


def spinning(omega: float):
    return at_rest()._replace(omega=omega)


@pytest.mark.parametrize("plant", [COASTING, DAMPED], ids=["dry", "damped"])
def test_friction_dissipates(plant):
    """Friction dissipates at least f_d times the distance; a stop dissipates all that remains."""
    x = run(plant, at_rest(), 10_000, load=lambda t: 0.4 * math.sin(2500 * t))
    assert np.abs(x.omega).max() > 5.0
    m = plant.mechanics
    way = np.abs(x.omega[1:] + x.omega[:-1]) / 2 * DT
    work = -0.4 * np.sin(2500 * DT * np.arange(10_000)) * (x.omega[1:] + x.omega[:-1]) / 2 * DT
    loss = work - m.J / 2 * np.diff(x.omega**2)
    # The mid-point rule makes the work of a constant force exact, so that only rounding remains.
    moving = x.omega[1:] != 0.0
    assert (loss >= m.f_d * way * (1 - 1e-9))[moving].all()
    stopping = ~moving & (x.omega[:-1] != 0.0)
    assert stopping.sum() >= 3
    assert loss.sum() > 0.0
    # A stop removes at most the speed gained in one step, for any load.
    highest = (0.4 + m.f_d) / m.J * DT
    assert np.abs(x.omega[:-1][stopping]).max() <= highest


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_end_stop_holds_and_releases(direction):
    plant = unpowered(constants(ActuatorParameters(theta_stop=1e-3)))
    stop, play = direction * 1e-3 / ACTUATOR.tau, ACTUATOR.BLK
    hit = run(plant, spinning(direction * 300.0), 4000, load=-direction * 0.5)
    assert np.abs(hit.theta_m).max() == abs(stop)
    assert (hit.theta_m[2500:] == stop).all()
    assert (hit.omega[2500:] == 0.0).all()
    # The stop acts before the backlash: the output stays half a play short of the stop.
    assert hit.theta_b[-1] == pytest.approx(stop - direction * play / 2, rel=1e-12)
    end = hit[-1]
    state = at_rest(float(end.theta_m), float(end.theta_b))
    left = run(plant, state, 1000, load=direction * 0.5)
    m = plant.mechanics
    # Free acceleration from rest; damping takes C t / 2 J = 2e-4 of it.
    expected = -direction * (0.5 - m.f_d) / m.J * 1e-3
    assert left.omega[-1] == pytest.approx(expected, rel=3e-4)


def currents(x: np.recarray) -> np.ndarray:
    return np.stack([x.i_a, x.i_b, x.i_c], axis=1)


def command_for(I_ref: float, theta_m: float = 0.0) -> float:
    """Return the command that requests a current from a motor locked at an angle."""
    return I_ref * ACTUATOR.k_t / (ACTUATOR.GAP * ACTUATOR.G_prop) + theta_m * ACTUATOR.tau


@pytest.mark.parametrize("N", [1.0, 0.6])
def test_locked_rotor_current_rises_as_RL(N):
    """Phases B and C are in series; half their difference does not depend on switching of A."""
    plant = locked(PLANT._replace(motor=PLANT.motor._replace(N_b=N, N_c=N)))
    V, R, L = ACTUATOR.V_max, ACTUATOR.R_s * N, ACTUATOR.L_s * N**2
    duration = 1.2e-4  # in which no phase reaches the current limit
    errors = []
    for dt in (2e-6, 1e-6, 5e-7):
        steps = round(duration / dt)
        x = run(plant, at_rest(), steps, command=1.0, dt=dt)
        rise = (x.i_c - x.i_b) / 2
        n = np.arange(steps + 1)
        # The recursion is solved by a power, so that only rounding remains.
        np.testing.assert_allclose(rise, V / R * (1 - (1 - dt * R / L) ** n), atol=1e-11)
        errors.append(np.abs(rise - V / R * (1 - np.exp(-n * dt * R / L))).max())
    # The error of explicit Euler is V/R (t dt / 2 tau^2) exp(-t / tau), at most V/R dt / (2 e tau).
    assert errors[1] < 1.1 * V / R * DT * R / L / (2 * math.e)
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 1.0, atol=0.05)


def largest_rise(i: float) -> float:
    """Return an upper bound for the change of a phase current in a step of ``DT`` [A].

    The healthy motor is at rest, and the current of the phase is at most ``i`` [A].
    """
    v = 4 / 3 * ACTUATOR.V_max / 2 + ACTUATOR.R_s / 2 * i
    return v / (ACTUATOR.L_s / 2) * DT


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0, 15, 45, 75, 100, 200, 301])
@pytest.mark.parametrize("I_ref", [-15.0, 2.0, 12.0])
def test_currents_stay_within_the_double_band(degrees, I_ref):
    """The errors of three phases add up to zero: an error can be as large as the sum of two.

    A leg within its band does not act, and the star point passes on the currents of the others.
    Thus a phase can leave its band until another phase reaches its own edge, at twice the
    half-band.
    """
    theta = math.radians(degrees) / ACTUATOR.P
    command = command_for(I_ref, theta)
    x = run(locked(PLANT), at_rest(theta, theta), 4000, command=command)
    targets = [I_ref * driven(degrees - 120 * n) for n in range(3)]
    error = np.abs(currents(x)[1500:] - targets)
    assert error.max() <= 2 * ACTUATOR.h_b + largest_rise(16.0)
    # The bound is meaningful: currents leave the single band by far.
    assert error.max() > 1.5 * ACTUATOR.h_b


FAULTY = {
    "healthy": {},
    "multiple": {
        "friction": 0.5,
        "short_circuit_b": 0.4,
        "eccentricity": 0.5,
        "eccentricity_phase": 0.3,
    },
}
LOAD = 0.1


class Energies(NamedTuple):
    """Energies of a run [J]."""

    electrical: float
    copper: float
    magnetic: float
    kinetic: float
    friction: float
    viscous: float
    load: float

    @property
    def residue(self) -> float:
        return self.electrical - sum(self[1:])


def energies(plant: PlantConstants, duration: float, dt: float) -> Energies:
    """Run from rest at full power, integrated by the mid-point rule."""
    x = run(plant, at_rest(), round(duration / dt), command=1.0, load=LOAD, dt=dt)
    motor, mech = plant.motor, plant.mechanics
    N = np.array([motor.N_a, motor.N_b, motor.N_c])
    i = np.stack([x.i_a, x.i_b, x.i_c], axis=1)
    q = np.stack([x.q_a, x.q_b, x.q_c], axis=1)[1:]
    i_mid = (i[1:] + i[:-1]) / 2
    omega_mid = (x.omega[1:] + x.omega[:-1]) / 2
    assert x.torque.max() < motor.T_max
    return Energies(
        electrical=float(np.sum(motor.V_max / 2 * q * i_mid) * dt),
        copper=float(np.sum(motor.R_s / 2 * N * i_mid**2) * dt),
        magnetic=float(np.sum(motor.L_s / 4 * N**2 * (i[-1] ** 2 - i[0] ** 2))),
        kinetic=float(mech.J / 2 * (x.omega[-1] ** 2 - x.omega[0] ** 2)),
        friction=float(np.sum(mech.f_d * np.abs(omega_mid)) * dt),
        viscous=float(np.sum(mech.C * omega_mid**2) * dt),
        load=float(np.sum(LOAD * omega_mid) * dt),
    )


@pytest.mark.parametrize("name", FAULTY)
def test_energy_is_conserved(name):
    """Electrical in = copper + magnetic + kinetic + friction + viscous + load.

    The star point does no work. Losses are equal in every step, while the converted energy has an
    error equal to its change within a step: an error of first order in the step.
    """
    plant = degrade(PLANT, fault_vector(FAULTY[name]))
    steps = (2e-6, 1e-6, 5e-7)
    runs = [energies(plant, 3e-3, dt) for dt in steps]
    for run_ in runs:
        assert min(run_) > 0.0
    relative = np.array([abs(run_.residue) / run_.electrical for run_ in runs])
    assert relative[1] < 1.5e-4
    # Switching differs between step sizes, so that the order is only approximate.
    np.testing.assert_allclose(np.log2(relative[:-1] / relative[1:]), 1.0, atol=0.2)


# Switching patterns are chaotic. Yet both sides of a symmetry compare the same currents with the
# same bands, and so agree to rounding, 1e-13 A and rad/s here, unless a comparison is closer than
# that. In these runs, none is; a different outcome would be 0.04 A.
TOLERANCE = 1e-9
STEPS = 8000
FAULTS = {
    "healthy": {},
    "short_circuit": {"short_circuit_a": 0.1, "short_circuit_b": 0.5},
    "eccentricity": {"eccentricity": 0.5, "eccentricity_phase": 0.8},
    "multiple": {
        "friction": 0.3,
        "backlash": 0.05,
        "short_circuit_b": 0.4,
        "short_circuit_c": 0.1,
        "eccentricity": 0.3,
        "eccentricity_phase": 0.1,
        "gain": 0.3,
    },
}
parametrize_faults = pytest.mark.parametrize("faults", FAULTS.values(), ids=FAULTS.keys())


def command(t: float) -> float:
    return 2e-3 * math.sin(1200 * t)


def load(t: float) -> float:
    return 0.05 * math.sin(500 * t)


def plant_with(faults) -> PlantConstants:
    return degrade(PLANT, fault_vector(faults))


def phase_currents(x: np.recarray) -> dict[str, np.ndarray]:
    return {"a": x.i_a, "b": x.i_b, "c": x.i_c}


def assert_same_motion(x: np.recarray, y: np.recarray, sign: float = 1.0, offset: float = 0.0):
    np.testing.assert_allclose(x.theta_m, sign * (y.theta_m - offset), rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.theta_b, sign * (y.theta_b - offset), rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.omega, sign * y.omega, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.torque, sign * y.torque, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.lag_3, sign * y.lag_3, rtol=0, atol=TOLERANCE)
    assert np.abs(x.omega).max() > 20.0


@pytest.mark.slow
@parametrize_faults
def test_mirrored_motion(faults):
    """Turning backwards swaps B and C and reverses the eccentricity; no current changes sign.

    The switching states swap likewise, so that equal states at the start, as in `at_rest`, are
    their own mirror image.
    """
    plant = plant_with(faults)
    motor = plant.motor
    mirrored = plant._replace(motor=motor._replace(N_b=motor.N_c, N_c=motor.N_b, phi=-motor.phi))
    x = run(plant, at_rest(), STEPS, command=command, load=load)
    y = run(mirrored, at_rest(), STEPS, command=lambda t: -command(t), load=lambda t: -load(t))
    assert_same_motion(x, y, sign=-1.0)
    np.testing.assert_allclose(x.i_a, y.i_a, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(x.i_b, y.i_c, rtol=0, atol=TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("P", [1, 2, 3])
@parametrize_faults
def test_phases_are_alike(faults, P):
    """A fault in A equals a fault in B a third of an electrical turn later.

    The air gaps are a third of a mechanical turn apart: the eccentricity must follow by this angle
    minus the rotation of the rotor.
    """
    actuator = ACTUATOR.replace({"P": P})
    plant = degrade(constants(actuator), fault_vector(faults))
    motor = plant.motor
    third = 2 * math.pi / 3
    turn = third / P
    moved = plant._replace(
        motor=motor._replace(
            N_b=motor.N_a, N_c=motor.N_b, N_a=motor.N_c, phi=motor.phi - third - turn
        )
    )
    x = run(plant, at_rest(), STEPS, command=command, load=load)
    y = run(
        moved,
        at_rest(turn, turn),
        STEPS,
        command=lambda t: command(t) + turn * actuator.tau,
        load=load,
    )
    assert_same_motion(x, y, offset=turn)
    i, j = phase_currents(x), phase_currents(y)
    for phase, next_phase in ("ab", "bc", "ca"):
        np.testing.assert_allclose(i[phase], j[next_phase], rtol=0, atol=TOLERANCE)
