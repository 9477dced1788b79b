"""The validation windows of the benchmarks are the same in every run."""

import importlib
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ema_core.faults import ECCENTRICITY, N_FAULTS, healthy_faults

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def cases() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        return importlib.import_module("cases")


def test_a_case_gives_the_same_window_each_time_and_another_seed_another(cases):
    one, other = cases.healthy(2)
    window, again = (one.window(one.telemetry(), noisy=True) for _ in range(2))
    np.testing.assert_array_equal(window.current, again.current)
    # The modulation is chaotic: another stir leaves another ripple, of some 0.1 A.
    clean, another = (case.window(case.telemetry(), noisy=False) for case in (one, other))
    assert np.std(clean.current - another.current) > 0.05


def test_the_sensors_add_their_noise_to_the_same_run(cases):
    [case] = cases.wide(1)
    telemetry = case.telemetry()
    clean, noisy = (case.window(telemetry, noisy=noisy) for noisy in (False, True))
    # 5000 samples tell a standard deviation to 1 % (one sigma).
    assert np.std(noisy.current - clean.current) == pytest.approx(cases.CURRENT_NOISE, rel=0.05)
    assert np.ptp(noisy.telemetry.speed - clean.telemetry.speed) <= cases.RESOLUTIONS["speed"]


def test_only_windows_with_an_approach_know_the_place_in_the_play(cases):
    [approached], [anywhere] = cases.wide(1), cases.without_approach(1)
    assert approached.window(approached.telemetry(), noisy=False).play == 1.0
    assert anywhere.window(anywhere.telemetry(), noisy=False).play is None


def test_more_cases_leave_the_first_ones_as_they_are(cases):
    assert cases.wide(7)[:3] == cases.wide(3)
    assert cases.by_the_law(7)[:3] == cases.by_the_law(3)


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


def test_a_step_is_one_fault_of_its_size(cases):
    for fault in cases.DETECTABLE:
        for case in cases.step(fault, 0.01, 5):
            away = np.abs(np.array(case.faults) - healthy_faults())
            if fault == ECCENTRICITY:
                away[ECCENTRICITY + 1] = 0.0
            assert away == pytest.approx(0.01 * np.eye(N_FAULTS)[fault])


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
