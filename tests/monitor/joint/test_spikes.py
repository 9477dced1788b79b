# SPDX-License-Identifier: Apache-2.0
"""Spikes of the effort, and no other samples, are replaced."""

from dataclasses import replace

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.identification.joint_estimate import identify_record
from ema_monitor.joint.signals import cutoff_of, motion_band
from ema_monitor.joint.spikes import despiked
from ema_monitor.quantities import FRICTION

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
    window_of,
)

JOINT = Joint(gravity=0.4)
HERTZ = 3.0


def spiked(telemetry: Telemetry, share: float, size: float, seed: int = 0) -> Telemetry:
    """Return the telemetry with a share of its efforts replaced by a value."""
    wrong = np.random.default_rng(seed).random(len(telemetry)) < share
    return replace(telemetry, current=np.where(wrong, size, telemetry.current))


@pytest.fixture(scope="module")
def calibration() -> JointCalibration:
    return calibrate_joint(list(map(window_of, healthy_telemetry(JOINT))), described())


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.5])
@pytest.mark.parametrize("size", [-20.0, 50.0, 500.0])
def test_spikes_are_replaced_by_their_neighbours(noise, size):
    plain = telemetry_of(JOINT, tones(), Sensors(noise=noise))
    share = 0.005
    result = despiked(spiked(plain, share, size), HERTZ)
    assert result.spikes == np.count_nonzero(spiked(plain, share, size).current == size)
    change = np.abs(result.telemetry.current - plain.current)
    assert np.count_nonzero(change) <= result.spikes
    # A reversal changes the effort by twice the Coulomb friction.
    assert np.max(change) < 2.0 * JOINT.coulomb + 0.5 + 6.0 * noise


@pytest.mark.parametrize(
    "motion", [tones(), tones(h=0.002), tones(speed=2.0), ramps(), places()], ids=lambda m: len(m.q)
)
@pytest.mark.parametrize("noise", [0.0, 0.05, 1.0, 20.0])
@pytest.mark.parametrize("step", [0.0, 0.5])
def test_effort_without_spikes_is_unchanged(motion: Motion, noise, step):
    """Steps of friction, quantisation and normal noise are not spikes."""
    telemetry = telemetry_of(replace(JOINT, stribeck=1.0), motion, Sensors(noise=noise))
    if step:
        telemetry = replace(telemetry, current=step * np.round(telemetry.current / step))
    assert despiked(telemetry, HERTZ).telemetry is telemetry


@pytest.mark.parametrize("h", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("seed", range(3))
def test_short_peaks_of_a_coarse_record_are_not_spikes(h, seed):
    """The inertia of a quick joint gives peaks of one sample in a record with a low rate."""
    fine = telemetry_of(Joint(inertia=2.0), places(h=0.002, seed=seed), EXACT)
    every = round(h / 0.002)
    columns = {name: getattr(fine, name)[::every] for name in ("command", "current", "position")}
    coarse = replace(fine, sample_period=h, interpolated=np.empty(0, dtype=bool), **columns)
    assert despiked(coarse, cutoff_of(motion_band(coarse), h)).telemetry is coarse


@pytest.mark.parametrize(("share", "size"), [(0.002, 500.0), (0.005, 50.0), (0.01, 20.0)])
@pytest.mark.parametrize("friction", [1.0, 1.3])
def test_spikes_change_no_judgement_and_are_counted(calibration, share, size, friction):
    plain = telemetry_of(JOINT.times(coulomb=friction), tones(), Sensors(), seed=9, day=60)
    wrong = spiked(plain, share, size)
    expected, actual = (
        identify_record(window_of(item), described(), calibration) for item in (plain, wrong)
    )
    assert expected.comparison is not None
    assert actual.comparison is not None
    assert actual.verdict == expected.verdict
    assert [item.name for item in actual.comparison.changed] == [
        item.name for item in expected.comparison.changed
    ]
    shift = actual.comparison[FRICTION].change - expected.comparison[FRICTION].change
    assert abs(shift) < 0.005
    count = np.count_nonzero(wrong.current == size)
    assert f"The effort has {count} spikes in {len(plain)} samples" in actual.reason
    assert "spike" not in expected.reason


def test_spikes_of_a_healthy_record_do_not_change_the_baseline(calibration):
    healthy = healthy_telemetry(JOINT)
    healthy[4] = spiked(healthy[4], 0.005, 500.0)
    spiked_calibration = calibrate_joint(list(map(window_of, healthy)), described())
    assert not spiked_calibration.outliers
    expected, actual = (
        item.comparer.smallest_changes[FRICTION] for item in (calibration, spiked_calibration)
    )
    assert actual == pytest.approx(expected, rel=0.05)
    np.testing.assert_allclose(
        spiked_calibration.baseline.healthy, calibration.baseline.healthy, atol=0.002
    )
