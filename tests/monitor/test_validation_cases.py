"""The validation windows of the benchmarks are the same in every run."""

from types import ModuleType

import numpy as np
import pytest

from ..benchmarks import benchmark


@pytest.fixture(scope="module")
def cases() -> ModuleType:
    return benchmark("cases")


def test_a_case_gives_the_same_window_each_time_and_another_seed_another(cases):
    one, other = cases.healthy(2)
    window, again = (one.window(one.telemetry(), noisy=True) for _ in range(2))
    np.testing.assert_array_equal(window.current, again.current)
    # The modulation is chaotic: another stir leaves another ripple, of some 0.1 A.
    clean, another = (case.window(case.telemetry(), noisy=False) for case in (one, other))
    assert np.std(clean.current - another.current) > 0.05


def test_sets_share_no_window(cases):
    sets = [
        *cases.by_the_law(5),
        *cases.wide(5),
        *cases.without_approach(5),
        *cases.healthy(5),
        *cases.healthy(5, "calibration"),
        *(case for row in cases.thesis_faults(3).values() for case in row),
        *(case for fault in cases.DETECTABLE for case in cases.step(fault, 0.01, 2)),
        *(case for p in cases.plants(cases.wide(4), 2, 3) for case in p.healthy + p.faulty),
    ]
    assert len({case.seed for case in sets}) == len(sets)


def test_plants_are_off_by_five_percent_at_most_and_share_the_faults_out(cases):
    faulty = cases.wide(7)
    plants = cases.plants(faulty, 3, 2)
    assert sorted(c.faults for p in plants for c in p.faulty) == sorted(c.faults for c in faulty)
    nominal = faulty[0].plant.as_mapping()
    for plant in plants:
        [off] = {case.plant for case in plant.healthy + plant.faulty}
        values = off.as_mapping()
        assert values == pytest.approx(nominal, rel=cases.PLANT_TOLERANCE, abs=0.0)
        assert values != pytest.approx(nominal, rel=0.005)
