# SPDX-License-Identifier: Apache-2.0
"""Validation windows of the benchmarks are reproducible, and foreign actuators are as described."""

from types import ModuleType

import numpy as np
import pytest

from ema_core.faults import fault_vector

from ..benchmarks import benchmark

STEP = 1e-4
COMMAND = 2e-3 * np.sin(2.0 * np.pi * 10.0 * STEP * np.arange(600))


@pytest.fixture(scope="module")
def effects() -> ModuleType:
    return benchmark("foreign.effects")


def run(plant, faults=(), **causes):
    return plant.telemetry(
        COMMAND, fault_vector(dict(faults)), causes, np.random.default_rng(3), STEP
    )


@pytest.mark.parametrize("effects_of", ["DEVELOPMENT", "HELD_OUT"])
def test_plant_behaves_as_the_registries_of_faults_and_causes_state(effects, effects_of):
    plant = effects.draw_plant(7, getattr(effects, effects_of))
    healthy = run(plant)
    # A lag of 5 ms: the bandwidth of the position loop is tau G_prop, 200 rad/s.
    assert np.max(np.abs(healthy.position - COMMAND)) < 1e-3
    assert np.corrcoef(np.gradient(healthy.position, STEP), healthy.speed / 500.0)[0, 1] > 0.99
    rubbing = run(plant, {"friction": 0.5})
    assert np.mean(np.abs(rubbing.current)) > 1.3 * np.mean(np.abs(healthy.current))
    # The flap stands still while the motor crosses the play, a quarter of a radian.
    loose = run(plant, {"backlash": 0.5})
    assert np.sum(np.diff(loose.position) == 0.0) > np.sum(np.diff(healthy.position) == 0.0)
    # Sensors: up to twice the resolution, at most 0.02 A each, and the same noise.
    wrong = run(plant, current_gain=0.05, current_offset=0.1)
    np.testing.assert_allclose(wrong.current, 1.05 * healthy.current + 0.1, atol=0.05)
    np.testing.assert_array_equal(wrong.speed, healthy.speed)
    shift = np.mean(run(plant, load_torque=0.3).current - healthy.current)
    assert shift == pytest.approx(0.3 / plant.parameters.k_e, rel=0.25)
    assert not np.any(run(plant, jam=1.0).speed)


def test_effect_does_not_change_the_numbers_of_the_others(effects):
    everything = effects.draw_plant(7, effects.DEVELOPMENT)
    without = effects.draw_plant(7, effects.DEVELOPMENT - {effects.Effect.COGGING})
    assert without.parameters == everything.parameters
    assert without.inverter == everything.inverter
    assert not np.any(without.cogging)
    np.testing.assert_array_equal(without.emf, everything.emf)


@pytest.fixture(scope="module")
def cases() -> ModuleType:
    return benchmark("cases")


def test_case_gives_the_same_window_each_time_and_another_seed_a_different_one(cases):
    first_case, second_case = cases.healthy(2)
    window, again = (first_case.window(first_case.telemetry(), noisy=True) for _ in range(2))
    np.testing.assert_array_equal(window.current, again.current)
    # The modulation is chaotic: a different tremble gives a different ripple of about 0.1 A.
    clean, another = (
        case.window(case.telemetry(), noisy=False) for case in (first_case, second_case)
    )
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


def test_plants_deviate_by_at_most_five_percent_and_share_all_faults(cases):
    faulty = cases.wide(7)
    plants = cases.plants(faulty, 3, 2)
    assert sorted(c.faults for p in plants for c in p.faulty) == sorted(c.faults for c in faulty)
    nominal = faulty[0].plant.as_mapping()
    for plant in plants:
        [off] = {case.plant for case in plant.healthy + plant.faulty}
        values = off.as_mapping()
        assert values == pytest.approx(nominal, rel=cases.PLANT_TOLERANCE, abs=0.0)
        assert values != pytest.approx(nominal, rel=0.005)


def test_errors_of_sensors_have_their_stated_size():
    errors = benchmark("sensor_errors")
    telemetry = errors.simulate({})
    most = np.max(np.abs(telemetry.current))
    rest = {"faults": errors.fault_vectors(0)[0], "seed": 0, "column": "current"}
    gain, offset, delay = (errors.Case(error=error, percent=10, **rest) for error in errors.ERRORS)
    np.testing.assert_allclose(gain.misread(telemetry).current, 1.1 * telemetry.current)
    np.testing.assert_allclose(
        offset.misread(telemetry).current, telemetry.current + 0.1 * most, atol=1e-9
    )
    # 1 ms is ten samples.
    late = delay.misread(telemetry).current
    np.testing.assert_allclose(late[10:], telemetry.current[:-10], atol=1e-6 * most)
    np.testing.assert_array_equal(delay.misread(telemetry).speed, telemetry.speed)


@pytest.mark.parametrize(
    ("faults", "level"),
    [
        ({"friction": 0.09}, 0),
        ({"friction": 0.12}, 1),
        # Beyond its limit by less than a tenth.
        ({"friction": 0.52}, 1),
        ({"gain": 0.2}, 2),
        ({"eccentricity_phase": 0.9}, 0),
    ],
)
def test_due_level_follows_the_limits(faults, level):
    due = benchmark("sensor_errors").due_level(tuple(fault_vector(faults)))
    assert due == level
