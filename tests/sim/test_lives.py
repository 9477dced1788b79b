"""Simulated lives: their length, their laws, their tests, and that a seed fixes them."""

import math

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, TYPICAL, healthy_faults
from ema_core.growth_laws import hours_until
from ema_sim.lives import LifeSettings, constant_life, run_to_failure

LIMITS = {
    "friction": 0.5,
    "backlash": 0.5,
    "short_circuit_a": 0.25,
    "short_circuit_b": 0.25,
    "short_circuit_c": 0.25,
    "eccentricity": 0.6,
    "gain": 0.25,
}
REACH = np.array([LIMITS.get(name, np.inf) for name in FAULT_NAMES])


def away(faults):
    return np.abs(faults - healthy_faults())


def lives_of(kind, count=12, **options):
    return [run_to_failure(LIMITS, np.random.default_rng(i), kind, **options) for i in range(count)]


@pytest.mark.parametrize("kind", TYPICAL)
def test_lives_last_from_60_to_200_tests(kind):
    for life in lives_of(kind):
        assert 60 <= len(life.hours) <= 200
        assert life.hours[-1] <= life.end_hours <= life.hours[-1] + 10.0
        assert np.array_equal(life.hours, 10.0 * np.arange(len(life.hours)))


@pytest.mark.parametrize("kind", TYPICAL)
def test_only_the_dominant_fault_reaches_its_limit_and_only_at_the_end(kind):
    for life in lives_of(kind):
        name = life.dominant
        assert name.startswith("short_circuit_") if kind == "short_circuit" else name == kind
        share = away(life.faults) / REACH
        assert np.all(share < 1.0)
        assert int(np.argmax(share[-1])) == FAULT_NAMES.index(name)


def test_end_is_where_the_law_reaches_the_limit_when_there_is_no_noise():
    settings = LifeSettings(process_noise=0.0)
    for kind in ("friction", "backlash", "short_circuit", "eccentricity"):
        life = run_to_failure(LIMITS, np.random.default_rng(3), kind, settings)
        growth = life.growths[life.dominant]
        limit = LIMITS[life.dominant]
        law = float(hours_until(growth.law, 0.0, growth.rate, growth.shape, limit))
        # Between tests the end is found on a straight line.
        assert life.end_hours == pytest.approx(growth.onset + law, abs=1.0)


@pytest.mark.slow
def test_others_grow_at_a_fifth_of_their_rates():
    lives = [*lives_of("backlash", 60), *lives_of("gain", 60)]
    for name, kind in (("friction", "friction"), ("eccentricity", "eccentricity")):
        rates = [life.growths[name].rate / TYPICAL[kind].rate for life in lives]
        expected = 5.0 if kind == "eccentricity" else 0.2
        assert np.exp(np.mean(np.log(rates))) == pytest.approx(expected, rel=0.12)


def _constant(seed):
    return constant_life(LIMITS, np.random.default_rng(seed))


def test_nothing_grows_in_a_constant_life():
    levels = []
    for seed in range(40):
        life = _constant(seed)
        assert np.all(life.faults == life.faults[0])
        assert life.end_hours == math.inf
        assert life.dominant == ""
        levels.append(away(life.faults[0]) / REACH)
    assert 0.0 < np.max(levels) < 0.6 + 1e-12
    assert min(np.count_nonzero(level) for level in levels) <= 1


def test_repair_puts_the_dominant_fault_back_and_life_counts_from_there():
    for kind in TYPICAL:
        for life in lives_of(kind, 3, with_repair=True):
            column = FAULT_NAMES.index(life.dominant)
            value = away(life.faults)[:, column]
            at = int(life.repair_hours / 10.0)
            assert value[at] == 0.0
            assert value[at - 1] > 0.0
            assert 60 <= len(life.hours) - at <= 200
            others = np.delete(away(life.faults), column, axis=1)
            assert np.all(others[at] >= 0.5 * others[at - 1])


def test_same_seed_same_life():
    first, second = (run_to_failure(LIMITS, np.random.default_rng(9)) for _ in range(2))
    assert np.array_equal(first.faults, second.faults)
    assert (first.windows, first.end_hours) == (second.windows, second.end_hours)
    other = run_to_failure(LIMITS, np.random.default_rng(10))
    assert other.end_hours != first.end_hours


@pytest.mark.parametrize(
    ("limits", "kind", "settings", "parts"),
    [
        ({**LIMITS, "gain": 0.0}, None, None, ("gain", "0.0")),
        ({"gain": 0.2}, None, None, ("friction", "None")),
        (LIMITS, "rust", None, ("'rust'", "backlash")),
        (LIMITS, "gain", LifeSettings(interval_hours=1000.0), ("1000 lives", "60 to 200")),
    ],
)
def test_impossible_lives_are_refused(limits, kind, settings, parts):
    with pytest.raises(ValueError, match=parts[0]) as refused:
        run_to_failure(limits, np.random.default_rng(0), kind, settings)
    assert parts[1] in str(refused.value)
