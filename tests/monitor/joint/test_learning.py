# SPDX-License-Identifier: Apache-2.0
"""The learned coefficients equal the plant, and include only terms that records show."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.joint.baseline import Baseline
from ema_monitor.joint.comparing import Comparer
from ema_monitor.joint.comparison import Judgement
from ema_monitor.joint.learning import learn
from ema_monitor.joint.record import JointRecord, read_record
from ema_monitor.joint.shape import DRY, GRAVITY, INERTIA, LOAD, VISCOUS
from ema_monitor.joint.wording import baseline_sentences
from ema_monitor.quantities import FRICTION, FRICTION_OVER_INERTIA
from ema_monitor.quantities import GRAVITY as GRAVITY_TORQUE
from ema_monitor.quantities import INERTIA as INERTIA_OF_JOINT
from ema_monitor.quantities import VISCOUS as VISCOUS_FRICTION

from .plant import (
    EXACT,
    Joint,
    Motion,
    Sensors,
    described,
    healthy_telemetry,
    places,
    ramps,
    telemetry_of,
    tones,
)


def learned(
    joint: Joint | None = None,
    sensors: Sensors | None = None,
    motion: Motion | None = None,
    *,
    scatter: float = 0.0,
    a_day: int = 1,
    seed: int = 0,
) -> Baseline:
    """Return the baseline of three days of records, without scatter unless ``scatter`` is given."""
    records = healthy_telemetry(joint, sensors, motion, scatter=scatter, a_day=a_day, seed=seed)
    return learn(records, described(sensors, records[0].sample_period))


def coefficients(baseline: Baseline) -> dict[str, float]:
    """Return the healthy coefficients, keyed by their names in the plant."""
    healthy, shape = baseline.healthy, baseline.shape
    return {
        "coulomb": healthy[DRY] * shape.coulomb,
        "inertia": healthy[INERTIA],
        "viscous": healthy[VISCOUS],
        "load": healthy[LOAD],
        "gravity": healthy[GRAVITY] * shape.sine,
    }


def check(joint: Joint, baseline: Baseline, rel: float, abs_load: float = 0.005) -> None:
    """Check all coefficients except gravity: relatively [-], and the load absolutely [A]."""
    learned_values = coefficients(baseline)
    for name in ("coulomb", "inertia", "viscous"):
        assert learned_values[name] == pytest.approx(getattr(joint, name), rel=rel), name
    assert learned_values["load"] == pytest.approx(joint.load, abs=abs_load)


def test_coefficients_without_noise_equal_those_of_the_plant():
    joint = Joint()
    # Central differences with steps of 0.02 s miss (2 pi 0.83 Hz 0.02 s)^2 / 3 = 0.4 % of the
    # acceleration in the faster tone, and half as much of the speed.
    check(joint, learned(joint, EXACT), rel=0.006, abs_load=0.002)


def test_gravity_without_noise_equals_that_of_the_plant():
    joint = Joint(gravity=0.8)
    baseline = learned(joint, EXACT)
    assert coefficients(baseline)["gravity"] == pytest.approx(0.8, rel=0.01)
    # The angle counts from the middle of the motion: gravity there belongs to the load.
    at_centre = joint.gravity * np.sin(baseline.shape.centre)
    assert coefficients(baseline)["load"] == pytest.approx(joint.load + at_centre, abs=0.002)


@pytest.mark.parametrize("coulomb", [0.3, 3.0])
@pytest.mark.parametrize("inertia", [0.03, 0.3])
def test_coefficients_are_right_for_other_ratios_of_friction_and_inertia(coulomb, inertia):
    joint = Joint(coulomb=coulomb, inertia=inertia)
    learned_values = coefficients(learned(joint, EXACT))
    # Near reversals, the filter smooths the sign of the speed, by 5 % in the rows with the highest
    # weight. These are few, and coupled to viscous friction.
    assert learned_values["coulomb"] == pytest.approx(coulomb, rel=0.01)
    # With friction of 3 A and an inertia of 0.03, 1 % of friction is 5 % of the effort of inertia.
    assert learned_values["inertia"] == pytest.approx(inertia, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensors",
    [
        Sensors(outliers=0.01),
        Sensors(noise=0.2),
        Sensors(step=2.0 * np.pi / 4096.0),
        Sensors(step=2.0 * np.pi / 1024.0, position_noise=1e-3),
        Sensors(speed=True),
        Sensors(speed=True, step=2.0 * np.pi / 1024.0),
        Sensors(command=False),
    ],
    ids=["outliers", "noise", "12 bits", "10 bits", "speed", "speed and 10 bits", "no command"],
)
def test_outliers_noise_and_resolution_do_not_bias_the_coefficients(sensors):
    joint = Joint()
    baselines = [learned(joint, sensors, seed=seed) for seed in range(3)]
    mean = {
        name: np.mean([coefficients(baseline)[name] for baseline in baselines])
        for name in ("coulomb", "inertia", "viscous", "load")
    }
    # The bias by differences is 0.6 %. The random error of 9 records with a noise of 0.2 A at 100
    # Hz is 0.2 / sqrt(9 * 4000) = 0.1 % of 1 A, and four times that for correlated columns.
    assert mean["coulomb"] == pytest.approx(joint.coulomb, rel=0.01)
    assert mean["inertia"] == pytest.approx(joint.inertia, rel=0.01)
    assert mean["viscous"] == pytest.approx(joint.viscous, rel=0.02)
    assert mean["load"] == pytest.approx(joint.load, abs=0.005)


def test_load_above_the_friction_is_a_load_though_the_effort_never_changes_sign():
    joint = Joint(inertia=0.02, load=8.0)
    baseline = learned(joint)
    check(joint, baseline, rel=0.02, abs_load=0.05)


def test_repeated_record_is_refused():
    records = healthy_telemetry(Joint(), None, None, scatter=0.0, a_day=1, seed=0)
    again = len(records) + 1
    with pytest.raises(ValueError, match=f"healthy records 2 and {again} are identical"):
        learn([*records, records[1]], described(None, records[0].sample_period))


@pytest.mark.parametrize("motion", [tones(), places()], ids=["tones", "places"])
@pytest.mark.parametrize("lag_s", [-0.03, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.12])
def test_lag_of_the_effort_is_corrected(motion, lag_s):
    joint = Joint()
    baseline = learned(joint, Sensors(lag_s=lag_s), motion)
    assert baseline.preparation.lag_s == pytest.approx(lag_s, abs=2e-3)
    prompt, late = coefficients(learned(joint, motion=motion)), coefficients(baseline)
    for name in ("coulomb", "inertia", "viscous"):
        assert late[name] == pytest.approx(prompt[name], rel=0.01), name


@pytest.mark.parametrize("lag_s", [-0.06, 0.0, 0.06])
def test_calibration_notes_a_large_lag(lag_s):
    baseline = learned(sensors=Sensors(lag_s=lag_s))
    remarks = [
        remark for remark in baseline_sentences(Comparer(baseline)) if "than the motion" in remark
    ]
    way = "later" if lag_s > 0.0 else "earlier"
    size = abs(1e3 * baseline.preparation.lag_s)
    expected = (
        f"the effort is {size:.0f} ms {way} than the motion and the described "
        "acquisition explain; the lag is corrected"
    )
    assert [remark.split(":")[0] for remark in remarks] == ([expected] if lag_s else [])


def test_lag_explained_by_the_acquisition_is_not_noted():
    """A mean current at 25 Hz is early by half a sample, 20 ms."""
    records = healthy_telemetry(motion=tones(h=0.04))
    description = described(h=0.04)
    acquisition = replace(description.acquisition, current="mean")
    baseline = learn(records, replace(description, acquisition=acquisition))
    assert baseline.preparation.unexpected_lag_s == pytest.approx(baseline.preparation.lag_s + 0.02)
    kept = replace(
        baseline, preparation=baseline.preparation._replace(lag_s=-0.02, unexpected_lag_s=0.0)
    )
    assert "acquisition explain" not in " ".join(baseline_sentences(Comparer(kept)))


@pytest.mark.parametrize("seed", range(5))
def test_no_lag_is_reported_without_one(seed):
    assert learned(sensors=Sensors(noise=0.2), seed=seed).preparation.lag_s == 0.0


@pytest.mark.parametrize("h", [0.001, 0.004, 0.02])
def test_record_of_another_rate_has_the_same_coefficients(h):
    baseline = learned()
    resampled = telemetry_of(Joint(), tones(h=h), Sensors(), seed=5)
    record = read_record(resampled, described(h=h), baseline.preparation, baseline.shape)
    at = [DRY, INERTIA, VISCOUS]
    # Differences with steps of 0.02 s instead of 0.02 to 0.025 s, see above, and noise.
    np.testing.assert_allclose(record.values[at], baseline.healthy[at], rtol=0.015)


# Terms


def test_gravity_is_part_of_the_model_if_present():
    assert learned(Joint(gravity=0.2)).shape.has_gravity


@pytest.mark.parametrize("seed", range(3))
def test_gravity_is_not_part_of_the_model_if_absent(seed):
    assert not learned(seed=seed).shape.has_gravity


def test_linear_joint_has_no_gravity():
    joint = Joint(gravity=0.5)
    records = healthy_telemetry(joint, scatter=0.0)
    assert not learn(records, described(lead=0.005)).shape.has_gravity
    assert learn(records, described()).shape.has_gravity


def test_stribeck_friction_is_part_of_the_model_if_present():
    """The motion has many speeds from 0.05 rad/s on, in strokes of 2 s."""
    strong = learned(Joint(stribeck=0.8, stribeck_speed=0.25), motion=_many_speeds(), a_day=2)
    assert strong.shape.dip > 0.0
    # Of the three candidate speeds (0.06, 0.12, 0.24 of the usual one), the nearest is at most a
    # third away; friction at rest deviates accordingly.
    assert strong.shape.dip == pytest.approx(0.8, rel=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_stribeck_friction_is_not_part_of_the_model_if_absent(seed):
    assert learned(motion=_many_speeds(), a_day=2, seed=seed).shape.dip == 0.0


def _many_speeds() -> Motion:
    """Return strokes of 2 s, whose speeds vary between 0.05 and 1 rad/s."""
    whole = ramps(80.0)
    t = whole.time
    speed = np.geomspace(0.05, 1.0, 10)[(t // 4.0).astype(int) % 10]
    v = whole.v / 0.5 * speed
    h = t[1] - t[0]
    return Motion(t, h * np.cumsum(v), v, np.gradient(v, h))


def test_friction_at_one_speed_is_not_split_into_coulomb_and_viscous():
    joint, speed = Joint(), 0.5
    baseline = learned(joint, Sensors(noise=0.1), ramps(speed=speed))
    assert not baseline.shape.has_viscous
    # The noise of 3 records is 0.1 / sqrt(3 * 4000) = 0.2 % of the friction.
    assert baseline.friction == pytest.approx(joint.coulomb + joint.viscous * speed, rel=0.01)


def test_inertia_without_acceleration_is_left_out():
    joint = Joint(inertia=0.001)
    assert not learned(joint, Sensors(noise=0.1), ramps()).shape.has_inertia
    assert learned(motion=tones()).shape.has_inertia


def test_records_without_motion_friction_or_direction_are_refused_with_the_reason():
    with pytest.raises(ValueError, match="at least one healthy record"):
        learn([], described())
    still = tones()
    still = Motion(still.time, 0.0 * still.q, 0.0 * still.v, 0.0 * still.a)
    with pytest.raises(ValueError, match="no motion"):
        learned(motion=still)
    with pytest.raises(ValueError, match="does the effort have the sign of the motion"):
        learned(Joint(coulomb=-1.0))
    short: list[Telemetry] = [telemetry.part(0, 150) for telemetry in healthy_telemetry()]
    with pytest.raises(ValueError, match="no healthy record can be used"):
        learn(short, described())


def test_records_of_unknown_travel_are_recognised_as_equal_by_their_stamps():
    """Records of older calibrations have no travel."""
    record = JointRecord(5, np.zeros(2), np.eye(2), 1.0)
    assert record.is_same(replace(record, values=np.ones(2)))
    assert not record.is_same(replace(record, stamp_ns=6))
    assert not record.is_same(replace(record, travel=2.0))
    assert replace(record, travel=2.0).is_same(replace(record, travel=2.0))


@pytest.mark.parametrize("payload", [1.2, 1.4])
def test_payload_is_not_mistaken_for_load_dependent_friction(payload):
    """Inertia and gravity grow by 20 % and more, and with them the load-dependent friction."""
    joint = Joint(coulomb=1.0, gravity=4.0, inertia=0.4, load_share=0.08)
    records = healthy_telemetry(joint, None, tones(), scatter=0.01, a_day=3)
    described_joint = described(None, records[0].sample_period)
    baseline = learn(records, described_joint)
    assert baseline.shape.load_share > 0.02
    heavy = joint.times(gravity=payload, inertia=payload)
    telemetry = telemetry_of(heavy, tones(), Sensors(), day=30)
    comparison = Comparer(baseline).compare(
        read_record(telemetry, described_joint, baseline.preparation, baseline.shape)
    )
    named = {quantity.name for quantity in comparison.changed} - {FRICTION_OVER_INERTIA}
    assert named == {GRAVITY_TORQUE, INERTIA_OF_JOINT}
    assert comparison[FRICTION].judgement is not Judgement.CHANGED


def test_effort_unexplained_by_the_motion_is_named_as_the_reason():
    """More speeds would not show viscous friction."""
    rng = np.random.default_rng(0)
    records = []
    for record in healthy_telemetry(motion=tones()):
        t = record.sample_period * np.arange(len(record))
        of_another = sum(
            2.5 * np.sin(2.0 * np.pi * hertz * t + rng.uniform(0.0, 6.0))
            for hertz in (0.2, 0.37, 0.55, 0.7)
        )
        records.append(replace(record, current=record.current + of_another))
    comparer = Comparer(learn(records, described()))
    text = " ".join(baseline_sentences(comparer))
    assert "does not explain a large part of the effort" in text
    assert "half the speed" not in text
    comparison = comparer.compare(comparer.baseline.records[0])
    assert comparison[VISCOUS_FRICTION].judgement is Judgement.NOT_JUDGED
    assert "does not explain a large part of the effort" in comparison[VISCOUS_FRICTION].reason


def test_motion_is_the_reason_if_the_effort_is_explained():
    comparer = Comparer(learned(motion=ramps()))
    assert not comparer.baseline.is_unexplained
    assert "half the speed" in " ".join(baseline_sentences(comparer))
