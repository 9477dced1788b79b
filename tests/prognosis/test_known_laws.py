"""Growth laws as users write them."""

import pytest

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
