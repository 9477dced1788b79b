"""Growth laws as users write them, and the curves that a fault of unknown law may follow."""

import numpy as np
import pytest

from ema_core.growth_laws import hours_until, increment
from ema_monitor.prognosis.growth.cells import BENDS, JUMPS, curves_of
from ema_monitor.prognosis.growth.settings import NOMINAL_LAWS, KnownLaw, KnownLawTexts, known_law


def test_law_without_figures_is_that_of_the_type():
    assert known_law("backlash", "archard") == NOMINAL_LAWS["backlash"]


def test_figures_are_rate_and_second_figure_of_the_law():
    assert known_law("friction", "power:900:1.5") == KnownLaw("power", 900.0, shape=1.5)
    assert known_law("friction", "linear:1e-3") == KnownLaw("linear", 1e-3)
    assert known_law("gain", "drift:1e-4:2e-4") == KnownLaw("drift", 1e-4, diffusion=2e-4)


@pytest.mark.parametrize(
    ("fault", "written", "message"),
    [
        ("frction", "linear:1e-3", "unknown fault 'frction'"),
        ("friction", "cubic", "unknown law of friction 'cubic'"),
        ("friction", "constant", "unknown law of friction 'constant'"),
        ("friction", "archard", "median rate of friction is known for law exponential only"),
        ("friction", "linear:fast", "'linear:fast' of friction: could not convert"),
        ("friction", "linear:-1", "rate"),
        ("friction", "power:900", "law power needs a second figure"),
        ("friction", "archard:1e-3", "law archard needs a second figure"),
        ("eccentricity", "power:1e-9:1.6", "takes .* h: expected 50 to 30000 h"),
        ("friction", "linear:1e6", "takes 5e-07 h: expected 50 to 30000 h"),
        ("friction", "exponential:2e-3:0", "needs an x_0 above 0"),
        ("friction", "power:900:1:2", "expected at most two"),
    ],
)
def test_text_that_is_no_law_is_refused_by_name(fault, written, message):
    with pytest.raises(ValueError, match=message):
        known_law(fault, written)


def test_law_of_short_circuits_is_that_of_each_phase():
    laws = KnownLawTexts(short_circuit="self_heating", gain="drift:1e-4:2e-4").laws()
    assert sorted(laws) == ["gain", "short_circuit_a", "short_circuit_b", "short_circuit_c"]
    assert laws["short_circuit_b"] == NOMINAL_LAWS["short_circuit_b"]


def test_impossible_text_among_several_is_named():
    with pytest.raises(ValueError, match=r"^eccentricity = .cubic.: unknown law"):
        KnownLawTexts(friction="exponential", eccentricity="cubic")


def test_number_is_no_law():
    """As a parameter file may give it."""
    with pytest.raises(ValueError, match=r"friction = 0\.5: expected a text"):
        KnownLawTexts(friction=0.5)


LIMIT = 0.25
HOUR = 1e-8
"""Hours so few that growth over them gives its speed."""


def bend(curve):
    """Return the speed at the limit over the mean speed on the way there."""
    until = hours_until(curve.law, 0.0, 1.0, curve.shape, LIMIT)
    speed = increment(curve.law, LIMIT, 1.0, curve.shape, HOUR) / HOUR
    return float(speed * until / LIMIT)


def test_each_law_has_the_same_bends():
    curves = curves_of(LIMIT, None, two_sided=False)
    # Those of two laws are the same curves and stand there once.
    for laws in (("archard", "exponential"), ("self_heating",), ("power",)):
        found = sorted(bend(curve) for curve in curves if curve.law in laws)
        assert found == pytest.approx(BENDS, rel=1e-4)
    lines = [bend(curve) for curve in curves if curve.law == "linear"]
    assert lines == pytest.approx([1.0] * (1 + len(JUMPS)))


def test_every_curve_is_as_probable_as_any_other():
    curves = curves_of(LIMIT, None, two_sided=False)
    shares = [curve.share for curve in curves if not curve.jumps]
    assert len(shares) == 1 + 3 * len(BENDS)
    assert shares == pytest.approx([shares[0]] * len(shares))
    # Growth by jumps is as probable as a law with all its bends.
    assert sum(shares) == pytest.approx(1.0 - len(BENDS) * shares[0])


def test_drift_is_as_probable_as_a_law_with_all_its_bends():
    curves = curves_of(LIMIT, None, two_sided=True)
    drift = sum(curve.share for curve in curves if curve.law == "drift")
    assert drift == pytest.approx(sum(c.share for c in curves if c.law == "self_heating"))
    assert sum(curve.share for curve in curves) == pytest.approx(1.0)


def test_component_that_cannot_leave_healthy_to_either_side_does_not_drift():
    assert "drift" not in {curve.law for curve in curves_of(LIMIT, None, two_sided=False)}


@pytest.mark.parametrize("laws", [("archard", "exponential"), ("self_heating",), ("power",)])
def test_bend_between_two_of_the_grid_errs_by_little_of_the_hours_left(laws):
    """Seen over three quarters of life: by less than half of the 20 % that a prediction may."""
    curves = [c for c in curves_of(LIMIT, None, two_sided=False) if c.law in laws]
    left = []
    for curve in curves:
        until = hours_until(curve.law, 0.0, 1.0, curve.shape, LIMIT)
        now = increment(curve.law, 0.0, 1.0, curve.shape, 0.75 * until)
        speed = increment(curve.law, now, 1.0, curve.shape, HOUR) / HOUR
        # In hours that the rest would take at the speed of now.
        left.append(0.25 * until * speed / (LIMIT - now))
    assert 0.5 * np.max(np.abs(np.diff(np.log(left)))) < 0.5 * 0.2


def test_known_law_is_the_only_curve():
    known = KnownLaw("self_heating", 1e-4, shape=6.0)
    assert [(c.law, c.shape, c.share) for c in curves_of(LIMIT, known, two_sided=False)] == [
        ("self_heating", 6.0, 1.0)
    ]
