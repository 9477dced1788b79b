# SPDX-License-Identifier: Apache-2.0
"""Memory of the earlier tests of a unit."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.faults import FRICTION, SHORT_CIRCUITS, fault_vector
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.alternatives import Alternative
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.memory import NOTHING, SLOW, Memory
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.reason_texts import EQUAL_SHORTS
from ema_monitor.windows.finder import Segment

DAY = 86_400 * 10**9
INERTIA = CauseEstimate("inertia", 0.15, 0.005)
SHORTS = dict.fromkeys(("short_circuit_a", "short_circuit_b", "short_circuit_c"), 0.1)
KNOWN = fault_vector({"friction": 0.2})


def reported(day: int, *causes: CauseEstimate, valid: bool = True, **more) -> Estimate:
    """Return an estimate with a friction of 0.2 +- 0.01."""
    stamp, covariance = day * DAY, 1e-4 * np.eye(8)
    made = {"faults": KNOWN, "covariance": covariance, "unobservable": np.zeros(8, dtype=bool)}
    return Estimate(stamp, stamp, "a", 0, "c", causes=causes, valid=valid, **made, **more)


def surprise(memory: Memory, friction: float = 0.2, **causes: float) -> float:
    values = {name: np.array([value]) for name, value in causes.items()}
    return memory.surprise(fault_vector({"friction": friction})[None], values).item()


def test_remembered_values_widen_at_the_pace_of_possible_changes():
    memory = NOTHING.updated(reported(10, INERTIA))
    pace = SLOW["inertia"]
    for months in (0.0, 1.0, 12.0):
        later = memory.before(10 * DAY + round(months * 30 * DAY))
        variance = 0.005**2 + pace.at_least**2 + months * pace.in_month**2
        assert later.causes["inertia"].sigma == pytest.approx(np.sqrt(variance))
        assert later.causes["inertia"].value == 0.15


def test_test_before_the_latest_one_is_identified_alone_and_changes_nothing():
    memory = NOTHING.updated(reported(10, INERTIA))
    assert memory.before(9 * DAY) is NOTHING
    assert memory.updated(reported(9)) is memory
    assert memory.updated(reported(11, valid=False)) is memory
    assert memory.updated(reported(11, stretches=3)) is memory


def test_only_separated_causes_are_expected_of_the_next_test():
    pair = Alternative(("inertia",), ("torque_constant",))
    doubtful = NOTHING.updated(reported(1, INERTIA, alternatives=(pair,)))
    assert (doubtful.expected, doubtful.causes["inertia"]) == ((), INERTIA)
    assert "torque_constant" not in doubtful.causes
    clear = doubtful.updated(reported(2, INERTIA))
    assert clear.expected == (INERTIA,)
    # A later test that cannot separate causes changes nothing; loads are not remembered.
    later = clear.updated(reported(3, CauseEstimate("load_torque", 1.0, 0.1), alternatives=(pair,)))
    assert [cause.name for cause in later.expected] == ["inertia"]
    assert "load_torque" not in later.causes


@pytest.mark.parametrize("cause", ["viscous_friction", "friction_ripple", "stribeck"])
def test_doubt_about_a_cause_does_not_affect_a_fault_with_a_similar_name(cause):
    """The label of the fault is part of the label of the cause."""
    pair = Alternative(("inertia",), (cause,))
    memory = NOTHING.updated(reported(1, INERTIA, alternatives=(pair,)))
    assert np.isfinite(memory.variances[FRICTION])
    doubtful = Alternative(("friction",), (cause,))
    memory = NOTHING.updated(reported(1, INERTIA, alternatives=(doubtful,)))
    assert np.isinf(memory.variances[FRICTION])


@pytest.mark.parametrize("cause", ["current_gain", "speed_gain", "position_gain"])
def test_doubt_about_equal_shorts_makes_all_phases_doubtful_and_nothing_else(cause):
    pair = Alternative((cause,), EQUAL_SHORTS)
    memory = NOTHING.updated(reported(1, alternatives=(pair,)))
    assert np.all(np.isinf(memory.variances[SHORT_CIRCUITS]))
    assert np.isfinite(memory.variances[FRICTION])


def test_fault_may_grow_at_no_cost_and_a_jump_costs_a_limited_part_of_its_square():
    memory = NOTHING.updated(reported(1)).before(2 * DAY)
    assert surprise(memory, friction=0.9) == pytest.approx(0.0)
    assert surprise(memory, friction=0.19) < 0.5
    assert 5.0 < surprise(memory, friction=0.0) < 25.0
    near, far = (surprise(memory, torque_constant=value) for value in (-0.01, -0.15))
    # Ten sigma, whose square is 112.
    assert near < 1.0 < 15.0 < far < 20.0
    assert surprise(memory, load_torque=1.0) == 0.0


def test_values_that_a_window_contradicts_are_not_remembered():
    memory = NOTHING.updated(reported(1, INERTIA)).before(2 * DAY)
    assert memory.left_by(reported(2, INERTIA._replace(value=0.16))) is memory
    assert memory.left_by(reported(2, INERTIA._replace(value=0.0))).expected == ()
    assert memory.left_by(reported(2, valid=False)) is NOTHING


@pytest.fixture(scope="module")
def shorted(stirred_window):
    """Return three healthy tests, one per day, and two with equal shorts in three phases."""
    windows = [stirred_window(SHORTS if day > 3 else {}, day) for day in range(1, 6)]
    return [
        replace(window, telemetry=replace(window.telemetry, stamp_ns=day * DAY))
        for day, window in enumerate(windows, 1)
    ]


def followed(
    diagnosis: Diagnosis, windows, calibration, search: SearchSettings | None = None
) -> list[Estimate]:
    segments = [Segment(0, ActuatorDescription(), window) for window in windows]
    search = search or SearchSettings()
    states = [
        state for segment in segments for state in diagnosis.add(segment, calibration, search)
    ]
    return [state.estimate for state in states if isinstance(state, Diagnosed)]


def test_equal_shorts_are_separated_from_a_weaker_motor_by_their_onset(shorted, calibration):
    """The window alone names the torque constant, a single cause; neither is certain."""
    *_, last = followed(Diagnosis(), shorted, calibration)
    assert np.array(last.faults)[SHORT_CIRCUITS] == pytest.approx(0.1, abs=0.02)
    assert "torque_constant" not in {cause.name for cause in last.causes}
    assert "torque constant" in last.reason
    alone = SearchSettings(memory=False)
    *_, last = followed(Diagnosis(), shorted, calibration, alone)
    assert "torque_constant" in {cause.name for cause in last.causes}
    assert not last.warm_start


def test_history_of_a_unit_gives_a_bit_identical_memory(shorted, calibration):
    live = followed(Diagnosis(), shorted, calibration)
    restarted = Diagnosis()
    for test in live[:-1]:
        restarted.begin_at(ActuatorDescription(), test)
    [again] = followed(restarted, shorted[-1:], calibration)
    assert again.faults == live[-1].faults
    np.testing.assert_array_equal(again.quantiles, live[-1].quantiles)
