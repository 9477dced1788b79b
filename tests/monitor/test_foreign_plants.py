"""The foreign actuators of the benchmarks behave as the registries of faults and causes say."""

from types import ModuleType

import numpy as np
import pytest

from ema_core.faults import fault_vector, healthy_faults

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


@pytest.fixture(params=["DEVELOPMENT", "HELD_OUT"])
def plant(request, effects):
    return effects.draw_plant(7, getattr(effects, request.param))


def test_the_flap_follows_the_command(plant):
    telemetry = run(plant)
    # A lag of 5 ms: the position loop closes at tau G_prop, 200 rad/s.
    assert np.max(np.abs(telemetry.position - COMMAND)) < 1e-3
    assert np.corrcoef(np.gradient(telemetry.position, STEP), telemetry.speed / 500.0)[0, 1] > 0.99


def test_an_effect_leaves_the_figures_of_the_others_alone(effects):
    everything = effects.draw_plant(7, effects.DEVELOPMENT)
    without = effects.draw_plant(7, effects.DEVELOPMENT - {effects.Effect.COGGING})
    assert without.parameters == everything.parameters
    assert without.inverter == everything.inverter
    assert not np.any(without.cogging)
    np.testing.assert_array_equal(without.emf, everything.emf)


def test_friction_raises_the_current_and_backlash_holds_the_flap_back(plant):
    healthy = run(plant)
    rubbing = run(plant, {"friction": 0.5})
    assert np.mean(np.abs(rubbing.current)) > 1.3 * np.mean(np.abs(healthy.current))
    loose = run(plant, {"backlash": 0.5})
    # The flap stands still while the motor crosses the play, a quarter of a radian.
    standing = [np.mean(np.diff(one.position) == 0.0) for one in (healthy, loose)]
    assert standing[1] > standing[0]


def test_sensors_publish_their_gain_and_offset(plant):
    healthy, wrong = run(plant), run(plant, current_gain=0.05, current_offset=0.1)
    # Up to twice the resolution of the sensor, at most 0.02 A each; the same noise.
    np.testing.assert_allclose(wrong.current, 1.05 * healthy.current + 0.1, atol=0.05)
    np.testing.assert_array_equal(wrong.speed, healthy.speed)


def test_a_load_is_borne_by_the_current(plant):
    shift = np.mean(run(plant, load_torque=0.3).current - run(plant).current)
    assert shift == pytest.approx(0.3 / plant.parameters.k_e, rel=0.25)


def test_a_jam_holds_the_shaft(plant):
    assert not np.any(run(plant, jam=1.0).speed)


def test_a_healthy_vector_is_the_plant_itself(plant):
    one = run(plant)
    np.testing.assert_array_equal(
        one.current,
        plant.telemetry(COMMAND, healthy_faults(), {}, np.random.default_rng(3), STEP).current,
    )
