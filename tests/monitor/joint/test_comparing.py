# SPDX-License-Identifier: Apache-2.0
"""A change in a record is named or listed with its rivals, and never called unchanged."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ema_core.arrays import Array
from ema_monitor.joint.baseline import BETWEEN_DAYS, Shortcoming
from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.comparison import Comparison, Judgement
from ema_monitor.joint.record import JointRecord
from ema_monitor.joint.shape import DRY, Shape
from ema_monitor.joint.shape import GRAVITY as GRAVITY_COLUMN
from ema_monitor.joint.shape import INERTIA as INERTIA_COLUMN
from ema_monitor.joint.shape import LOAD as LOAD_COLUMN
from ema_monitor.joint.shape import VISCOUS as VISCOUS_COLUMN
from ema_monitor.quantities import (
    FRICTION,
    FRICTION_OVER_INERTIA,
    GRAVITY,
    INERTIA,
    LOAD,
    PLAY,
    QUANTITIES,
    TORQUE,
    TRACKING,
    VISCOUS,
)

from .baselines import (
    HEALTHY,
    SEPARATE,
    SHAPE,
    USUAL_SPEED,
    baseline_of,
    changed,
    drawn,
    drawn_effects,
    record_of,
)

OF_COEFFICIENTS = (FRICTION, VISCOUS, TORQUE, INERTIA, GRAVITY, LOAD)


@pytest.fixture(scope="module")
def comparer() -> Comparer:
    return Comparer(baseline_of())


def rivals(comparison: Comparison) -> set[str]:
    """Return the quantities that explain the record as well as the named ones."""
    return {name for quantity in comparison.changed for name in quantity.rivals}


def names(comparison: Comparison) -> set[str]:
    return {quantity.name for quantity in comparison.changed} - {FRICTION_OVER_INERTIA}


CASES = {
    "friction": ({"friction": 1.15}, FRICTION, 0.15),
    "less friction": ({"friction": 0.8}, FRICTION, -0.2),
    # Viscous friction follows the temperature, and scatters more between days.
    "viscous": ({"viscous": 0.3}, VISCOUS, 0.3),
    "torque": ({"torque": 0.9}, TORQUE, -0.1),
    "inertia": ({"inertia": 1.2}, INERTIA, 0.2),
    "load": ({"load": 0.15}, LOAD, 0.15),
    "gravity": ({"gravity": 1.6}, GRAVITY, 0.6),
}


@pytest.mark.parametrize(("change", "name", "size"), CASES.values(), ids=CASES)
def test_single_change_is_named_with_its_size(comparer, change, name, size):
    comparison = comparer.compare(record_of(changed(comparer.baseline.healthy, **change)))
    assert names(comparison) == {name}
    assert not rivals(comparison)
    # The record itself has no error. The differences are rounding, and the mean of the prediction,
    # whose weights of days differ slightly from the weights in the healthy coefficients.
    assert comparison[name].change == pytest.approx(size, abs=0.015)
    assert comparison[name].low < size < comparison[name].high
    assert comparison.probability < 1e-3
    assert comparison.has_departed


@pytest.mark.slow
@pytest.mark.parametrize(("change", "name", "size"), CASES.values(), ids=CASES)
def test_change_in_records_with_scatter_and_error_is_named_or_a_rival(comparer, change, name, size):
    rng = np.random.default_rng(1)
    named = 0
    for number in range(20):
        like = drawn(rng, SEPARATE + number, drawn_effects(rng, 0.01))
        comparison = comparer.compare(replace(like, values=changed(like.values, **change)))
        assert comparison[name].judgement is not Judgement.UNCHANGED, number
        named += name in names(comparison)
        # Other named quantities may only be rivals, or accompany the change.
        assert name in names(comparison) | rivals(comparison) or not names(comparison), number
    # All but a few are far above the smallest change (15 % compared with 6 % to 8 %).
    assert named >= 18


def test_payload_changes_gravity_and_inertia_together(comparer):
    record = record_of(changed(comparer.baseline.healthy, gravity=1.6, inertia=1.25))
    comparison = comparer.compare(record)
    assert names(comparison) == {GRAVITY, INERTIA}
    assert comparison[INERTIA].change == pytest.approx(0.25, abs=0.015)
    assert comparison[GRAVITY].change == pytest.approx(0.6, abs=0.02)
    assert comparison[FRICTION].judgement is Judgement.UNCHANGED


def test_payload_that_changes_the_gravity_at_the_centre_is_not_mistaken_for_friction():
    """The constant load increases too: a weaker motor with less friction would look alike."""
    healthy = np.array([1.2, 0.08, 0.75, 1.6, 1.0])
    comparer = Comparer(baseline_of(healthy=healthy, scatter=0.005))
    load = 0.2 * comparer.baseline.healthy[LOAD_COLUMN]
    record = record_of(changed(comparer.baseline.healthy, gravity=1.2, inertia=1.2, load=load))
    result = comparer.compare(record)
    assert names(result) - {LOAD} == {GRAVITY, INERTIA}
    assert result[GRAVITY].change == pytest.approx(0.2, abs=0.02)
    assert result[INERTIA].change == pytest.approx(0.2, abs=0.02)


def test_friction_and_torque_are_not_separated_when_nearly_all_effort_is_friction():
    """Inertia and gravity are 1 % of the friction, so that both changes have the same effect."""
    healthy = np.array([1.0, 0.12, 0.002, 0.0, 1.0])
    shape = Shape(coulomb=1.0, sine=0.004, has_gravity=True)
    base = baseline_of(healthy=healthy, shape=shape)
    # The inertia is known only to 30 %, which is too uncertain to detect a change of 15 %.
    records = tuple(
        replace(
            healthy_record,
            covariance=_vague(healthy_record.covariance),
            values=healthy_record.values,
        )
        for healthy_record in base.records
    )
    comparer = Comparer(replace(base, records=records))
    for change, rival in (({"friction": 1.2}, TORQUE), ({"torque": 1.0 / 1.2}, FRICTION)):
        values = changed(comparer.baseline.healthy, **change)
        record = record_of(values)
        comparison = comparer.compare(replace(record, covariance=_vague(record.covariance)))
        assert comparison.changed
        assert names(comparison) | rivals(comparison) >= {FRICTION, TORQUE}
        for name in (FRICTION, TORQUE):
            assert comparison[name].judgement is not Judgement.UNCHANGED
        assert comparison[rival].rivals or comparison[rival].judgement is Judgement.CHANGED


def _vague(covariance):
    """Return the covariance of a record that hardly shows inertia, viscous friction and gravity."""
    scales = np.array([1.0, 45.0, 10.0, 1.0, 100.0])
    return covariance * np.outer(scales, scales)


def _with_payload(values, payload: float):
    """Return coefficients with a payload that adds this share of gravity and inertia."""
    factors = np.ones(5)
    factors[[INERTIA_COLUMN, GRAVITY_COLUMN]] += payload
    return values * factors


@pytest.mark.parametrize("payload", [-0.1, 0.1])
def test_varying_payload_is_no_evidence_of_torque_per_ampere(payload):
    """In healthy records too, gravity and inertia rise together, as if the motor were weaker."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        base = baseline_of(seed, scatter=0.003)
        records = tuple(
            replace(item, values=_with_payload(item.values, rng.uniform(-0.1, 0.1)))
            for item in base.records
        )
        comparer = Comparer(replace(base, records=records))
        values = changed(comparer.baseline.healthy, friction=1.12)
        comparison = comparer.compare(record_of(_with_payload(values, payload)))
        assert FRICTION in names(comparison) | rivals(comparison), seed
        for item in comparison.changed:
            # A change of torque per ampere is never certain.
            assert item.name in (FRICTION, FRICTION_OVER_INERTIA) or FRICTION in item.rivals, seed


@pytest.mark.parametrize("count", [6, 10])
@pytest.mark.parametrize("seed", range(8))
def test_payloads_that_vary_with_the_task_are_no_change(count: int, seed: int):
    """Payloads of 10 % change inertia, gravity, and the load, which is gravity at the centre."""
    rng = np.random.default_rng(seed)

    def loaded(payload: float, second: int) -> JointRecord:
        values = np.array(HEALTHY)
        values[[INERTIA_COLUMN, GRAVITY_COLUMN]] *= 1.0 + payload
        values[LOAD_COLUMN] += 2.0 * payload
        return record_of(values, day=0, second=second, error=0.1)

    def payload() -> float:
        return rng.uniform(-0.1, 0.1)

    healthy = tuple(loaded(payload(), second) for second in range(count))
    comparer = Comparer(replace(baseline_of(), records=healthy))
    for second in range(count, count + 12):
        comparison = comparer.compare(loaded(payload(), second), with_improvements=False)
        assert not comparison.changed


@pytest.mark.parametrize(("error", "is_changed"), [(0.3, True), (0.02, False), (0.9, False)])
def test_effort_outside_the_model_makes_friction_uncertain(error: float, is_changed: bool):
    """Effort outside the model biases the friction, and differently with another payload."""
    records = [{"friction_error": 0.25 + 0.01 * at} for at in range(9)]
    baseline = baseline_of(records=records, shape=replace(SHAPE, friction_error=0.29))
    record = record_of(changed(HEALTHY, friction=1.4), friction_error=error)
    comparison = Comparer(baseline).compare(record)
    assert (FRICTION in names(comparison)) == is_changed
    assert comparison[FRICTION].change == pytest.approx(0.4, abs=0.03)
    certain = Comparer(replace(baseline, shape=SHAPE)).compare(record)
    assert FRICTION in names(certain)


def test_payload_correlates_gravity_and_inertia():
    def correlation(payload: float) -> float:
        rng = np.random.default_rng(3)
        base = baseline_of(scatter=0.003, days=3, a_day=6)
        records = tuple(
            replace(record, values=_with_payload(record.values, payload * rng.uniform(-1.0, 1.0)))
            for record in base.records
        )
        spread = Comparer(replace(base, records=records)).spread
        pair = [INERTIA_COLUMN, GRAVITY_COLUMN]
        (of_inertia, both), (_, of_gravity) = spread[np.ix_(pair, pair)]
        return float(both / np.sqrt(of_inertia * of_gravity))

    # Six of 24 records are assumed to be uncorrelated.
    assert correlation(0.2) > 0.6
    assert abs(correlation(0.0)) < 0.3


def test_torque_cannot_be_judged_if_only_friction_is_visible():
    shape = Shape(coulomb=1.0, has_inertia=False, has_viscous=False)
    healthy = np.array([1.0, 0.0, 0.0, 0.1, 1.0])
    comparer = Comparer(baseline_of(healthy=healthy, shape=shape))
    comparison = comparer.compare(record_of(changed(comparer.baseline.healthy, friction=1.3)))
    assert names(comparison) == {FRICTION}
    assert rivals(comparison) == {TORQUE, VISCOUS}
    for name in (TORQUE, VISCOUS, INERTIA, GRAVITY):
        assert comparison[name].judgement is Judgement.NOT_JUDGED
        assert comparison[name].reason


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_departing_record_is_never_called_unchanged(seed):
    """The records have any combination of changes of any size, and any error."""
    rng = np.random.default_rng(seed)
    comparer = Comparer(baseline_of(seed, days=1 + seed, a_day=3))
    for number in range(75):
        like = drawn(rng, SEPARATE + number, drawn_effects(rng, 0.01))
        sizes = rng.choice([0.0, 0.05, 0.1, 0.3, 1.0], 6) * rng.choice([-0.5, 1.0], 6)
        factors = dict(zip(("friction", "inertia", "gravity", "torque"), 1.0 + sizes, strict=False))
        values = changed(like.values, **factors, viscous=sizes[4], load=sizes[5])
        comparison = comparer.compare(replace(like, values=values))
        departs = comparison.probability < 1e-3
        # The combined probability is at least the probability of each test times their number.
        if departs and not comparison.figures:
            assert comparison.changed, number
        for quantity in comparison.quantities:
            if quantity.judgement is Judgement.UNCHANGED and quantity.name in OF_COEFFICIENTS:
                # Torque per ampere is shown as the inverse of the judged effort.
                inverse = 1.0 - quantity.smallest_change if quantity.name == TORQUE else 1.0
                assert abs(quantity.change) < quantity.smallest_change / inverse, (number, quantity)


@pytest.mark.slow
def test_unchanged_quantity_is_below_its_smallest_detectable_change(comparer):
    rng = np.random.default_rng(5)
    for number in range(50):
        comparison = comparer.compare(drawn(rng, SEPARATE + number, drawn_effects(rng, 0.01)))
        for quantity in comparison.quantities:
            if quantity.judgement is Judgement.UNCHANGED and not comparison.changed:
                assert abs(quantity.change) < quantity.smallest_change, quantity


@pytest.mark.slow
def test_healthy_records_of_the_assumed_scatter_give_no_alarm():
    """There are 30 baselines of one to five days, and ten records of other days for each."""
    rng = np.random.default_rng(7)
    alarms = []
    for seed in range(30):
        # The assumed scatter between days is 0.8 % of friction, and 0.7 % of inertia.
        comparer = Comparer(baseline_of(seed, days=1 + seed % 5, scatter=0.008))
        for number in range(10):
            record = drawn(rng, SEPARATE + number, drawn_effects(rng, 0.008), scatter=0.008)
            comparison = comparer.compare(record)
            alarms += [quantity.name for quantity in comparison.changed]
    # Six tests of 0.1 % each in 300 records give 1.8 alarms if the scatter is only just covered;
    # the prior covers four times the scatter.
    assert alarms == []


@pytest.mark.slow
def test_doubtful_change_is_not_judged_instead_of_unchanged(comparer):
    """Between three standard deviations and significance, friction is not judged."""
    healthy, seen = comparer.baseline.healthy, []
    for factor in np.linspace(1.02, 1.1, 81):
        comparison = comparer.compare(record_of(changed(healthy, friction=float(factor))))
        friction = comparison[FRICTION]
        seen.append(friction.judgement)
        if friction.judgement is Judgement.NOT_JUDGED and not friction.rivals:
            assert "beyond usual variation, but not certain" in friction.reason
            assert not comparison.changed
    steps = [
        judgement for judgement, following in pairwise([*seen, None]) if judgement is not following
    ]
    assert steps[0] is Judgement.UNCHANGED
    assert Judgement.NOT_JUDGED in steps
    assert steps[-1] is Judgement.CHANGED


def test_smaller_changes_are_detectable_on_a_day_with_healthy_records(comparer):
    same, separate = comparer.smallest_changes_of_a_day, comparer.smallest_changes
    assert same.keys() == separate.keys() == set(OF_COEFFICIENTS)
    assert all(same[name] < separate[name] for name in same)


@pytest.mark.slow
def test_more_days_lower_the_smallest_change_as_predicted():
    predicted, reached = [], []
    for seed in range(8):
        one_day, three_days = (
            Comparer(baseline_of(seed, days=days, scatter=BETWEEN_DAYS["friction"]))
            for days in (1, 3)
        )
        (improvement,) = one_day.improvements
        assert improvement.present_change == one_day.smallest_changes[FRICTION]
        assert (improvement.days, improvement.records) == (2, 6)
        assert improvement.smallest_change < 0.7 * one_day.smallest_changes[FRICTION]
        predicted.append(improvement.smallest_change)
        reached.append(three_days.smallest_changes[FRICTION])
    # The days scatter as assumed. The information of three days varies by 20 %, a mean of 8 by 8 %.
    assert np.mean(predicted) == pytest.approx(np.mean(reached), rel=0.2)


def test_gaps_name_the_missing_healthy_records():
    assert baseline_of(days=1, a_day=2).shortcomings == (
        Shortcoming.ONE_DAY,
        Shortcoming.FEW_RECORDS,
    )
    assert baseline_of().shortcomings == ()
    one_speed = baseline_of(shape=Shape(coulomb=1.0, has_viscous=False))
    assert one_speed.shortcomings == (Shortcoming.ONE_SPEED,)
    unexplained = baseline_of(shape=Shape(coulomb=1.0, has_viscous=False, unexplained=0.6))
    assert unexplained.shortcomings == (Shortcoming.UNEXPLAINED_EFFORT,)


def test_load_has_the_unit_of_the_effort():
    baseline = baseline_of()
    record = record_of(changed(baseline.healthy, load=0.2))
    load = Comparer(baseline, "N.m", 0.5).compare(record)[LOAD]
    assert load.unit == "N.m"
    assert load.change == pytest.approx(0.1, abs=0.01)


def test_friction_over_inertia_equals_the_coefficient_of_a_self_locking_gear(comparer):
    """Friction is 1.4 and inertia 1.1 times the healthy values."""
    record = record_of(changed(comparer.baseline.healthy, friction=1.4, inertia=1.1))
    ratio = comparer.compare(record)[FRICTION_OVER_INERTIA]
    assert ratio.change == pytest.approx(1.4 / 1.1 - 1.0, abs=0.01)
    assert ratio.low < ratio.change < ratio.high
    assert ratio.judgement is Judgement.CHANGED


def test_every_quantity_is_judged_once_in_order(comparer):
    comparison = comparer.compare(record_of(HEALTHY))
    assert [quantity.name for quantity in comparison.quantities] == list(QUANTITIES)
    assert comparison[PLAY].judgement is Judgement.NOT_JUDGED
    assert comparison[TRACKING].judgement is Judgement.NOT_JUDGED
    assert "no position command" in comparison[TRACKING].reason


def test_record_with_another_motion_is_judged_with_less_certainty(comparer):
    values = changed(comparer.baseline.healthy, friction=1.1)
    same = comparer.compare(record_of(values))
    faster = comparer.compare(record_of(values, usual_speed=1.4 * USUAL_SPEED))
    assert faster[FRICTION].smallest_change > 1.1 * same[FRICTION].smallest_change
    assert FRICTION in names(same)


# Temperature


def _warm(follows: bool, seed: int = 0) -> Comparer:
    """Return the comparer of twelve records over 20 K, whose viscous friction may follow it."""
    rng = np.random.default_rng(seed)
    kelvin = np.linspace(10.0, 30.0, 12)
    rng.shuffle(kelvin)
    base = baseline_of(
        seed, days=4, a_day=3, records=[{"temperature": float(item)} for item in kelvin]
    )
    records = []
    for item in base.records:
        values = np.array(item.values)
        if follows:
            values[VISCOUS_COLUMN] *= 1.0 - 0.02 * (item.temperature - 20.0)
        records.append(replace(item, values=values))
    return Comparer(replace(base, records=tuple(records)))


def _without_temperature(comparer: Comparer) -> Comparer:
    records = tuple(replace(record, temperature=math.nan) for record in comparer.baseline.records)
    return Comparer(replace(comparer.baseline, records=records))


def test_temperature_explains_the_scatter_of_viscous_friction_that_follows_it():
    with_it = _warm(follows=True)
    blind = _without_temperature(with_it)
    smallest = with_it.smallest_changes[VISCOUS], blind.smallest_changes[VISCOUS]
    # 2 %/K over 20 K is a scatter of 12 % of the viscous friction, in addition to 1 % between days.
    assert smallest[0] < 0.7 * smallest[1]
    values = np.array(HEALTHY)
    values[VISCOUS_COLUMN] *= 1.0 - 0.02 * 12.0
    warm = record_of(values, temperature=32.0)
    comparison = with_it.compare(warm)
    assert comparison[VISCOUS].judgement is Judgement.UNCHANGED
    # The change beyond the effect of temperature.
    assert abs(comparison[VISCOUS].change) < 0.03


def test_temperature_is_not_used_if_nothing_follows_it():
    with_it = _warm(follows=False, seed=1)
    weights = np.eye(5)[DRY]
    record = record_of(HEALTHY, temperature=80.0)
    plain = _without_temperature(with_it)
    for name in (FRICTION, VISCOUS):
        assert with_it.smallest_changes[name] == pytest.approx(plain.smallest_changes[name])
    assert with_it.compare(record)[FRICTION] == plain.compare(record)[FRICTION]
    assert with_it.scatter(weights).variance == pytest.approx(plain.scatter(weights).variance)


def test_record_without_temperature_is_compared_over_all_temperatures():
    """Any healthy temperature may explain its viscous friction, so there is no alarm."""
    comparer = _warm(follows=True)
    for healthy in comparer.baseline.records:
        unknown = comparer.compare(replace(healthy, stamp_ns=0, temperature=math.nan))
        assert unknown[VISCOUS].judgement is not Judgement.CHANGED
    at_20_degrees, unknown = (
        comparer.compare(record_of(HEALTHY, temperature=temperature))[VISCOUS].smallest_change
        for temperature in (20.0, math.nan)
    )
    assert unknown > 1.3 * at_20_degrees


def _all_friction_follows(per_kelvin: float) -> tuple[Comparer, Array]:
    """Return the comparer of records whose friction follows the temperature, and its change."""
    steady = _warm(follows=False)
    change = np.zeros(5)
    change[[DRY, VISCOUS_COLUMN]] = (
        per_kelvin * np.array([1.0, 3.0]) * HEALTHY[[DRY, VISCOUS_COLUMN]]
    )
    records = [
        replace(record, values=record.values + (record.temperature - 20.0) * change)
        for record in steady.baseline.records
    ]
    return Comparer(replace(steady.baseline, records=tuple(records))), change


def test_temperature_that_all_friction_follows_costs_no_sensitivity():
    """Dry and viscous friction vary together with temperature, and independently at a known one."""
    steady = _warm(follows=False)
    warm, _ = _all_friction_follows(-0.01)
    for name in (FRICTION, TORQUE, INERTIA):
        assert warm.smallest_changes[name] < 1.2 * steady.smallest_changes[name], name
    correlation = warm.correlations[DRY, VISCOUS_COLUMN]
    assert correlation == pytest.approx(steady.correlations[DRY, VISCOUS_COLUMN], abs=0.1)


@pytest.mark.parametrize("kelvin", [10.0, 20.0, 30.0])
@pytest.mark.parametrize(
    ("change", "name"), [({"friction": 1.15}, FRICTION), ({"inertia": 1.1}, INERTIA)]
)
def test_change_is_named_at_any_temperature_of_the_healthy_records(kelvin, change, name):
    """The effect of temperature is not part of the change."""
    warm, slope = _all_friction_follows(-0.01)
    values = np.array(HEALTHY) + (kelvin - 20.0) * slope
    comparison = warm.compare(record_of(changed(values, **change), temperature=kelvin))
    assert names(comparison) == {name}
    assert rivals(comparison) == set()


def test_effort_of_the_wrong_sign_is_a_change_and_not_an_error(comparer):
    """With friction of -1 times the healthy one, the logarithm of the ratio does not exist."""
    comparison = comparer.compare(record_of(-comparer.baseline.healthy))
    assert comparison.changed
    assert all(
        not quantity.is_judged or math.isfinite(quantity.change)
        for quantity in comparison.quantities
    )
