"""Which phase is driven where, and the shape of its back-EMF."""

import math

import numpy as np
import pytest

from ema_core.faults import degrade, fault_vector
from ema_core.parameters import ActuatorParameters, constants
from ema_sim.motor import commutation, gap_at, modulation, sector_at, trapezoid

from .reference_twin import back_emf_shape
from .reference_twin import driven as driven_sign

# Electrical degrees, clear of the edges at 30 + 60 n, where rounding decides.
ANGLES = [angle for angle in range(-720, 721, 5) if angle % 60 != 30]


def driven(degrees: float) -> tuple[float, ...]:
    """Signs of the three phase currents at an electrical angle."""
    return tuple(commutation(trapezoid(math.radians(degrees - 120 * n))) for n in range(3))


@pytest.mark.parametrize(
    ("start", "signs"),
    [
        (-30, (0, -1, 1)),
        (30, (1, -1, 0)),
        (90, (1, 0, -1)),
        (150, (0, 1, -1)),
        (210, (-1, 1, 0)),
        (270, (-1, 0, 1)),
    ],
)
def test_sector_drives_its_pair(start, signs):
    for degrees in np.linspace(start + 0.001, start + 59.999, 25):
        assert driven(degrees) == signs


def test_back_emf_is_a_trapezoid():
    degrees = np.arange(-720.0, 720.0, 1.25)
    corners = [0, 30, 150, 210, 330, 360], [0, 1, 1, -1, -1, 0]
    shape = [np.clip(trapezoid(math.radians(angle)), -1.0, 1.0) for angle in degrees]
    # Rounding of an angle of two turns is worth 12 / 2 pi of its 1e-15 in the shape.
    np.testing.assert_allclose(shape, np.interp(degrees % 360, *corners), atol=1e-13)


def test_driven_pair_adds_up_to_the_phase_to_phase_constant():
    """So the torque of a healthy motor is k_e times the current at every angle."""
    for degrees in ANGLES:
        shapes = [np.clip(trapezoid(math.radians(degrees - 120 * n)), -1, 1) for n in range(3)]
        assert np.dot(shapes, driven(degrees)) == 2.0


@pytest.mark.parametrize("P", [1, 2, 7])
def test_sector_holds_what_its_angles_have(P):
    actuator = ActuatorParameters(P=P)
    faults = {"short_circuit_a": 0.1, "short_circuit_b": 0.4, "short_circuit_c": 0.7}
    _, motor, mechanics = degrade(constants(actuator), fault_vector(faults))
    for degrees in np.arange(-719.0, 720.0, 2.0):  # 1, 3, ... and so no edge
        theta_m = math.radians(degrees) / P
        s = sector_at(motor, mechanics, theta_m)
        assert s.start < theta_m < s.end
        assert s.end - s.start == pytest.approx(math.pi / 3 / P)
        assert (s.s_a, s.s_b, s.s_c) == tuple(driven_sign(degrees - 120 * n) for n in range(3))
        delta = theta_m - s.middle
        k = s.k_a + s.dk_a * delta, s.k_b + s.dk_b * delta, s.k_c + s.dk_c * delta
        for n, N in enumerate((0.9, 0.6, 0.3)):
            expected = actuator.k_e / 2 * N * back_emf_shape(degrees - 120 * n)
            assert k[n] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("delta", [-5e-3, -1e-4, 0.0, 2e-3, 5e-3])
def test_gap_is_modulated_by_a_cosine_a_third_of_a_turn_apart(delta):
    _, motor, _ = degrade(
        constants(ActuatorParameters()),
        fault_vector({"eccentricity": 0.8, "eccentricity_phase": 0.3}),
    )
    for theta_m in np.linspace(-7.0, 7.0, 29):
        angle = theta_m + delta + motor.phi + 2 * math.pi / 3 * np.arange(3)
        found = modulation(gap_at(motor, theta_m), delta)
        # What the series leave out, 5e-3^5 / 120, is 3e-14.
        np.testing.assert_allclose(found, motor.zeta * np.cos(angle), rtol=0, atol=4e-14)
