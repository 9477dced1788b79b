# SPDX-License-Identifier: Apache-2.0
"""Levels, index and grade of health in closed form (docs/faults.md)."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ema_core.faults import FAULT_NAMES, FAULTS
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_monitor.health import (
    ONE_SIDED_95,
    FaultHealth,
    Health,
    HealthLimits,
    Tracked,
    assess,
    with_requirements,
)
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.joint.comparison import Comparison, FigureChange
from ema_monitor.quantities import FRICTION, PLAY, TORQUE, VISCOUS
from ema_monitor.reasons import StatedReason, Unjudged

from .comparisons import (
    CASES,
    EFFORT_UP,
    FRICTION_UP,
    HEALTHY,
    HEAVIER,
    HIDDEN,
    LOADED,
    PLAY_UP,
    changed,
    compared,
    comparison,
    not_judged,
    unchanged,
)
from .windows import estimated, refused

LIMITS = HealthLimits()
SIGMA = 0.01


def estimate(faults: dict[str, float] | None = None, **values: Any) -> Estimate:
    return estimated(faults, **{"goodness_of_fit": 1.0, **values})


def fault(of: Estimate, name: str, limits: HealthLimits = LIMITS) -> FaultHealth:
    [item] = [item for item in assess(of, limits).faults if item.name == name]
    return item


def test_healthy_actuator_is_healthy():
    health = assess(estimate(), LIMITS)
    assert (health.level, health.health_index, health.severity) == (OK, 1.0, 0)
    assert (health.confidence, health.dominant_fault, health.reason) == (1.0, "", "")
    assert [item.name for item in health.faults] == [
        name for name in FAULT_NAMES if name != "eccentricity_phase"
    ]
    assert {(item.level, item.share) for item in health.faults} == {(OK, 0.0)}


@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("friction", LIMITS.friction),
        ("backlash", LIMITS.backlash),
        ("short_circuit_a", LIMITS.short_circuit),
        ("short_circuit_b", LIMITS.short_circuit),
        ("short_circuit_c", LIMITS.short_circuit),
        ("eccentricity", LIMITS.eccentricity),
        ("gain", LIMITS.gain),
    ],
)
def test_levels_change_when_the_bound_passes_the_share_and_the_value_the_limit(
    name: str, limit: float
):
    healthy = FAULTS[FAULT_NAMES.index(name)].healthy
    warned = LIMITS.warn_share * limit + ONE_SIDED_95 * SIGMA
    for distance, level in (
        (warned - 1e-6, OK),
        (warned + 1e-6, WARN),
        (limit - 1e-6, WARN),
        (limit + 1e-6, ERROR),
    ):
        measured = estimate({name: healthy + distance})
        health, item = assess(measured, LIMITS), fault(measured, name)
        assert (item.level, health.level) == (level, level)
        assert item.share == pytest.approx(distance / limit)
        assert health.health_index == pytest.approx(max(0.0, 1.0 - distance / limit))
        assert health.dominant_fault == ("" if level == OK else name)
        assert (item.limit, item.limit_is_lower) == (pytest.approx(healthy + limit), False)
        assert item.warn_limit == pytest.approx(healthy + LIMITS.warn_share * limit)
        assert item.sigma == pytest.approx(SIGMA)


@pytest.mark.parametrize(
    ("share", "severity"),
    [(0.3, 1), (0.49, 1), (0.51, 2), (0.79, 2), (0.81, 3), (0.99, 3), (1.01, 4), (1.9, 4)],
)
def test_severity_is_graded_by_the_share(share: float, severity: int):
    assert assess(estimate({"friction": share * 0.5}), LIMITS).severity == severity


def test_worst_fault_determines_level_and_index():
    health = assess(estimate({"friction": 0.3, "backlash": 0.4, "eccentricity": 0.2}), LIMITS)
    assert (health.level, health.dominant_fault) == (WARN, "backlash")
    # A fault beyond its limit comes first, for any shares of the others.
    uncertain = HealthLimits(friction=0.9, gain=0.1)
    health = assess(estimate({"friction": 0.8, "gain": 0.61}), uncertain)
    assert (health.level, health.dominant_fault) == (ERROR, "gain")


def test_fault_that_no_test_has_shown_leaves_the_level_unknown():
    health = assess(estimate({"friction": 0.9}, unknown=("friction", "backlash")), LIMITS)
    assert health.level == STALE
    assert np.isnan(health.health_index)
    assert health.confidence == pytest.approx(5 / 7)
    assert (
        "no recent test has shown friction (shown by quick back-and-forth motion" in health.reason
    )
    assert "backlash (shown by motion that reverses)" in health.reason
    assert "not observable in this window: friction, backlash" in health.reason
    levels = {item.name: item.level for item in health.faults}
    assert (levels["friction"], levels["backlash"], levels["gain"]) == (STALE, STALE, OK)


def test_observable_fault_warns_regardless_of_unobservable_ones():
    health = assess(estimate({"gain": 0.6}, unknown=("friction", "backlash")), LIMITS)
    assert (health.level, health.dominant_fault) == (WARN, "gain")
    assert health.health_index == pytest.approx(0.6)


def test_value_that_may_be_beyond_the_limit_is_not_ok():
    # The 95 % bound of a healthy value, 1.645 times 0.16, is beyond the limit 0.25.
    wide = estimate(sigma=0.16)
    levels = {name: fault(wide, name).level for name in ("short_circuit_a", "friction")}
    assert levels == {"short_circuit_a": STALE, "friction": OK}
    assert assess(wide, LIMITS).level == STALE
    assert assess(estimate(sigma=0.15), LIMITS).level == OK


@pytest.mark.parametrize(("value", "level"), [(0.0, STALE), (0.3, WARN), (0.6, ERROR)])
def test_tracked_value_that_no_recent_test_shows_may_alarm_and_is_not_ok(value: float, level: int):
    made = estimate(unknown=("backlash",))
    old = {"backlash": Tracked(value, 0.01, is_recent=False)}
    health = assess(made, LIMITS, old)
    [item] = [item for item in health.faults if item.name == "backlash"]
    assert (item.level, health.level) == (level, level)
    assert np.isnan(health.health_index) == (level == STALE)
    recent = assess(made, LIMITS, {"backlash": Tracked(value, 0.01)})
    assert recent.level == (OK if level == STALE else level)


@pytest.mark.parametrize("limit", [2.0, 10.0])
@pytest.mark.parametrize(
    ("share", "confidence"), [(0.4, 1.0), (0.5, 1.0), (0.75, 0.5), (1.0, 0.0), (np.nan, 0.0)]
)
def test_confidence_decreases_as_the_fit_approaches_its_limit(
    limit: float, share: float, confidence: float
):
    made = estimate(
        goodness_of_fit=share * limit, goodness_limit=limit, reasons=(StatedReason("a poor fit"),)
    )
    health = assess(made, LIMITS)
    assert health.confidence == pytest.approx(confidence)
    assert health.reason == "a poor fit"


def test_health_needs_a_valid_estimate():
    with pytest.raises(ValueError, match="gap of 3 samples"):
        assess(refused("gap of 3 samples"), LIMITS)


def test_tracked_value_replaces_the_estimate():
    made = estimate({"friction": 0.3, "backlash": 0.2}, unknown=("friction",))
    health = assess(made, LIMITS, {"friction": Tracked(0.6, 0.01), "gain": Tracked(0.2, 0.01)})
    items = {item.name: item for item in health.faults}
    assert (items["friction"].value, items["friction"].level) == (0.6, ERROR)
    assert (items["gain"].value, items["gain"].level) == (0.2, ERROR)
    assert (items["gain"].limit, items["gain"].limit_is_lower) == (0.25, True)
    assert items["backlash"].value == 0.2
    assert (health.level, health.health_index, health.severity) == (ERROR, 0.0, 4)
    # The window does not show friction, but earlier windows do.
    assert "friction" in health.reason
    assert health.confidence == pytest.approx(6 / 7)


@pytest.mark.parametrize(
    ("before", "new", "level"),
    [(0.05, 0.06, OK), (0.05, 0.3, WARN), (0.05, 0.9, WARN), (0.3, 0.0, WARN), (0.6, 0.0, ERROR)],
)
def test_held_back_value_is_reported_if_a_level_depends_on_it(before, new, level):
    made = estimate({"friction": new})
    health = assess(made, LIMITS, {"friction": Tracked(before, 0.01, doubtful=True)})
    [item] = [item for item in health.faults if item.name == "friction"]
    assert (item.value, item.level) == (before, level)
    assert (item.held == new) == (level != OK)


@pytest.mark.parametrize(
    ("friction", "share", "level", "severity"),
    [(0.0, 0.1, OK, 0), (0.0, 0.6, WARN, 2), (0.0, 1.2, ERROR, 4), (0.45, 0.3, WARN, 3)],
)
def test_worse_of_faults_and_requirements_determines_the_level(
    friction: float, share: float, level: int, severity: int
):
    fault_level = ERROR if share > 1.0 else WARN if share > 0.2 else OK
    required = (FaultHealth("bandwidth", fault_level, 20.0, 0.1, 12.0, 14.0, True, share),)
    health = with_requirements(assess(estimate({"friction": friction}), LIMITS), required)
    assert (health.level, health.severity) == (level, severity)
    assert health.requirements == required
    best = 1.0 if level == OK else 0.99
    assert health.health_index == pytest.approx(min(1.0 - friction / 0.5, best))


def test_unknown_requirement_changes_nothing():
    required = (FaultHealth("bandwidth", STALE, 20.0, np.nan, 12.0, 14.0, True, 0.5),)
    health = assess(estimate(), LIMITS)
    assert with_requirements(health, required).level == health.level


def torque(of: Comparison) -> list[FaultHealth]:
    return [
        requirement
        for requirement in health_of(of).requirements
        if requirement.name == "torque_per_ampere"
    ]


def health_of(of: Comparison, limits: HealthLimits = LIMITS) -> Health:
    return assess(compared(of), limits)


def test_record_without_a_change_is_ok_if_the_warning_limit_would_be_detectable():
    health = health_of(HEALTHY)
    assert (health.level, health.health_index, health.severity) == (OK, 1.0, 0)
    assert health.confidence == len(HEALTHY.judged) / len(HEALTHY.quantities) < 1.0


def test_ok_needs_a_smallest_change_below_the_warning_limit():
    # A warning is given from k = 0.2 * 0.5 on: friction + 20 %.
    assert health_of(comparison(unchanged(FRICTION, 0.199))).level == OK
    health = health_of(comparison(unchanged(FRICTION, 0.35)))
    assert (health.level, health.confidence) == (STALE, 0.0)
    assert np.isnan(health.health_index)
    assert "above 35 % would show; its warning limit is 20 %" in health.reason
    assert OK not in {fault.level for fault in (*health.faults, *health.requirements)}
    wide = replace(LIMITS, warn_share=0.4)
    assert health_of(comparison(unchanged(FRICTION, 0.35)), wide).level == OK


def test_ok_needs_a_judgement_of_friction():
    health = health_of(comparison(not_judged(FRICTION)))
    assert health.level == STALE
    assert np.isnan(health.health_index)
    assert health.reason == f"Coulomb friction is not judged: {HIDDEN}"


def test_doubtful_change_leaves_the_level_unknown_and_is_named_with_its_size():
    doubt = replace(not_judged(FRICTION, Unjudged.DOUBTFUL), change=0.147, low=0.1, high=0.2)
    assert health_of(comparison(doubt)).reason == (
        "Coulomb friction is not judged: the change is beyond usual variation, but not certain: "
        "repeat the record, or add healthy records from further days; "
        "Coulomb friction may have changed by +14.7 %"
    )
    inertia = replace(not_judged("inertia", Unjudged.DOUBTFUL), change=0.05, low=0.02, high=0.08)
    assert health_of(comparison(unchanged(FRICTION, 0.06), inertia)).reason == (
        "inertia may have changed by +5.0 %, which is beyond usual variation, but not certain"
    )


def test_friction_tracked_over_earlier_tests_does_not_replace_its_judgement():
    estimate = compared(comparison(not_judged(FRICTION)))
    health = assess(estimate, LIMITS, {"friction": Tracked(0.0, 0.001)})
    assert health.level == STALE
    assert {fault.level for fault in health.faults} == {STALE}


@pytest.mark.parametrize(
    "of",
    [
        FRICTION_UP,
        EFFORT_UP,
        LOADED,
        PLAY_UP,
        HEAVIER,
        comparison(changed(VISCOUS, 1.0)),
        comparison(changed(FRICTION, -0.15)),
        replace(HEALTHY, figures=(FigureChange("tracking_error", 2.0, 1e-5),)),
    ],
)
def test_departure_warns_and_never_has_the_index_of_a_new_unit(of: Comparison):
    health = health_of(of)
    assert health.level in (WARN, ERROR)
    assert health.severity >= 1
    assert not health.health_index > 0.99


def test_index_of_a_departure_follows_the_share_of_its_limit():
    # Friction + 50 % is k = 0.25, half of the limit.
    assert health_of(comparison(changed(FRICTION, 0.5, 0.02))).health_index == pytest.approx(0.5)
    assert health_of(comparison(changed(FRICTION, 1.2, 0.02))).level == ERROR


def test_departure_without_friction_has_no_index_as_no_limit_is_known():
    health = health_of(
        comparison(changed(VISCOUS, 1.0), *(not_judged(name) for name in (FRICTION, TORQUE, PLAY)))
    )
    assert health.level == WARN
    assert np.isnan(health.health_index)


def test_torque_per_ampere_is_a_requirement_if_it_is_judged():
    [item] = torque(comparison(changed(TORQUE, -0.18, 0.02)))
    assert (item.value, item.limit_is_lower) == (pytest.approx(0.82), True)
    # Hot magnets may lose 5 %, one sigma, compared with 0.02 / 1.645 of the record.
    assert item.sigma == pytest.approx(np.hypot(0.02 / 1.645, 0.05))
    [item] = torque(HEALTHY)
    assert (item.value, item.level) == (1.0, OK)
    assert torque(comparison(not_judged(TORQUE, Unjudged.ONLY_FRICTION))) == []


def test_torque_that_is_not_separated_from_friction_is_not_blamed():
    assert torque(EFFORT_UP) == []


@pytest.mark.parametrize("name", sorted(set(CASES) - {"nothing"}))
def test_warning_is_never_next_to_the_index_of_a_new_unit(name: str):
    health = health_of(CASES[name])
    assert health.level != WARN or not health.health_index > 0.99


def test_departed_estimate_of_a_modelled_drive_never_has_the_index_of_a_new_unit():
    health = assess(
        estimate(verdict=Verdict.DEPARTED, reasons=(StatedReason("the current is 12 % higher"),)),
        LIMITS,
    )
    assert (health.level, health.health_index) == (WARN, 0.99)
