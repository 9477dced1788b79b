"""Points of the unit box and the fault vectors that they mean."""

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, HIGHEST, fault_vector
from ema_monitor.identification.objective import Coordinates


def modes(play=(0.25, None)):
    return [
        pytest.param(Coordinates(p, cartesian), id=f"play {p}, {'xy' if cartesian else 'polar'}")
        for p in play
        for cartesian in (True, False)
    ]


@pytest.mark.parametrize("coordinates", modes())
def test_encoding_then_decoding_returns_the_faults(coordinates):
    rng = np.random.default_rng(8)
    for _ in range(50):
        faults, play = rng.random(8) * HIGHEST, rng.uniform(-1.0, 1.0)
        point = coordinates.encode(faults, play)
        assert point.shape == ((8,) if coordinates.play is not None else (9,))
        assert np.all((point >= 0.0) & (point <= 1.0))
        [decoded], [decoded_play] = coordinates.decode(point[None])
        # The phase loses three digits at the smallest eccentricity drawn, 1e-3.
        assert decoded == pytest.approx(faults, abs=1e-12)
        assert decoded_play == pytest.approx(
            play if coordinates.play is None else coordinates.play, abs=1e-15
        )


@pytest.mark.parametrize("coordinates", modes())
def test_every_point_of_the_box_is_a_fault_vector(coordinates):
    d = 8 if coordinates.play is not None else 9
    rng = np.random.default_rng(9)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * d)).reshape(d, -1).T
    faults, play = coordinates.decode(np.concatenate([corners, rng.random((200, d))]))
    assert np.array_equal(fault_vector(faults), faults)
    assert np.all(np.abs(play) <= 1.0)


@pytest.mark.parametrize(("x", "y"), [(1.0, 1.0), (0.0, 1.0), (0.1, 0.05), (1.0, 0.9)])
def test_eccentricity_beyond_one_is_drawn_back_along_its_direction(x, y):
    point = np.full(8, 0.5)
    point[[ECCENTRICITY, ECCENTRICITY_PHASE]] = x, y
    [faults], _ = Coordinates(0.0, cartesian=True).decode(point[None])
    assert np.hypot(2 * x - 1, 2 * y - 1) > 1.0
    assert faults[ECCENTRICITY] == 1.0
    phi = (2 * faults[ECCENTRICITY_PHASE] - 1) * np.pi
    assert np.tan(phi) == pytest.approx((2 * y - 1) / (2 * x - 1), rel=1e-12)
    assert np.sign(np.cos(phi)) == np.sign(2 * x - 1)


@pytest.mark.parametrize("cartesian", [True, False])
def test_short_circuits_are_capped(cartesian):
    [faults], _ = Coordinates(0.0, cartesian).decode(np.ones((1, 8)))
    assert list(faults[2:5]) == [0.99] * 3
    assert np.all(faults <= HIGHEST)


def test_eccentricity_and_phase_in_the_plane():
    """A phase of 0.75 is phi = pi / 2: all of zeta in y."""
    faults = fault_vector({"eccentricity": 0.4, "eccentricity_phase": 0.75})
    point = Coordinates(0.0, cartesian=True).encode(faults)
    assert point[[ECCENTRICITY, ECCENTRICITY_PHASE]] == pytest.approx([0.5, 0.7], abs=1e-15)


@pytest.mark.parametrize("cartesian", [True, False])
def test_unknown_play_is_the_ninth_component(cartesian):
    coordinates = Coordinates(None, cartesian)
    faults = fault_vector({})
    for play, component in ((-1.0, 0.0), (0.0, 0.5), (1.0, 1.0)):
        point = coordinates.encode(faults, play)
        assert point[8] == component
        assert coordinates.decode(point[None])[1][0] == play
    assert coordinates.encode(faults)[8] == 0.5
