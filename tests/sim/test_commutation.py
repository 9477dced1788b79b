"""Which phase is driven where, and the shape of its back-EMF."""

import math

import numpy as np
import pytest

from ema_core.dynamics import clip
from ema_sim.reference import commutation, hysteresis, trapezoid

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


@pytest.mark.parametrize("turns", [-3, 1, 1000])
def test_commutation_repeats_every_electrical_turn(turns):
    for degrees in ANGLES:
        assert driven(degrees + 360 * turns) == driven(degrees)


def test_one_phase_in_one_phase_out():
    for degrees in ANGLES:
        assert sorted(driven(degrees)) == [-1, 0, 1]


def test_back_emf_is_a_trapezoid():
    degrees = np.arange(-720.0, 720.0, 1.25)
    corners = [0, 30, 150, 210, 330, 360], [0, 1, 1, -1, -1, 0]
    shape = [clip(trapezoid(math.radians(angle)), 1.0) for angle in degrees]
    # Rounding of an angle of two turns is worth 12 / 2 pi of its 1e-15 in the shape.
    np.testing.assert_allclose(shape, np.interp(degrees % 360, *corners), atol=1e-13)


def test_driven_pair_adds_up_to_the_phase_to_phase_constant():
    """So the torque of a healthy motor is k_e times the current at every angle."""
    for degrees in ANGLES:
        shapes = [clip(trapezoid(math.radians(degrees - 120 * n)), 1.0) for n in range(3)]
        assert np.dot(shapes, driven(degrees)) == 2.0


@pytest.mark.parametrize("switch", [1.0, -1.0])
@pytest.mark.parametrize("target", [-7.0, 0.0, 3.0])
def test_leg_switches_outside_the_band_only(switch, target):
    h_b = 0.5
    assert hysteresis(switch, target - 0.51, target, h_b) == 1.0
    assert hysteresis(switch, target + 0.51, target, h_b) == -1.0
    for inside in (-0.5, -0.49, 0.0, 0.49, 0.5):
        assert hysteresis(switch, target + inside, target, h_b) == switch
