"""What a test will show is told before it is made: predictions hold for windows of known noise."""

import math

import numpy as np
import pytest

from ema_core.faults import BACKLASH, COMPONENTS, FAULTS, SHORT_CIRCUITS, healthy_faults
from ema_monitor.design.certificate import (
    CauseProspect,
    Certificate,
    Repeated,
)
from ema_monitor.design.rehearsal import (
    HALF_WIDTH,
    N_COMBINED,
    FaultProspect,
    combined_faults,
    present,
    single_faults,
)


def test_single_faults_are_half_way_to_their_limits():
    for name, faults in single_faults().items():
        [number] = [i for i, fault in enumerate(FAULTS) if fault.name == name]
        limit = FAULTS[number].limit
        assert limit is not None
        assert faults[number] == pytest.approx(FAULTS[number].healthy + 0.5 * limit)
        others = present(faults) & (np.arange(len(FAULTS)) != number)
        assert not np.any(others[: SHORT_CIRCUITS[-1] + 1])


def test_every_fault_is_among_several_in_some_actuator_and_one_phase_is_shorted():
    actuators = [combined_faults(number) for number in range(N_COMBINED)]
    assert np.all(np.any([present(k) for k in actuators], axis=0))
    for k in actuators:
        assert np.count_nonzero(k[SHORT_CIRCUITS]) == 1
    assert {np.sign(k[-1] - healthy_faults()[-1]) for k in actuators} == {-1.0, 1.0}


@pytest.fixture
def certificate() -> Certificate:
    faults = [FaultProspect(name, True, 0.004, 0.002, 0.01, ()) for name in COMPONENTS]
    nan = math.nan
    faults[BACKLASH] = FaultProspect("backlash", False, nan, nan, nan, ("load torque",))
    faults[0] = faults[0]._replace(error=0.02)
    causes = (
        CauseProspect("torque_constant", 0.05, "named"),
        CauseProspect("load_torque", 0.3, "does not show"),
    )
    repeated = tuple(Repeated(name, 9, 0.004, 0.005, 0.001, 0.002, 0.9) for name in COMPONENTS)
    return Certificate("flap", "1", 0.01, 0.5, 1e-4, 0.02, nan, tuple(faults), causes, repeated)


def test_certificate_says_what_the_motion_does_not_show(certificate):
    text = str(certificate)
    assert "This motion does not show: backlash." in text
    assert "named: torque constant (5 %)" in text
    assert "does not show: load torque (0.3 N.m)" in text
    assert "larger than their intervals for: friction." in text
    # Predicted over measured: 0.004 / 0.005.
    assert "0.80" in text


def test_smallest_fault_is_told_in_physical_terms(certificate):
    meanings = {one.name: one.meaning for one in certificate.faults}
    assert meanings["friction"] == "dry friction 1.020 × nominal"
    assert meanings["gain"] == "position-loop gain 1.010 × nominal or 0.990"
    assert meanings["backlash"] == ""


def test_wanted_sigma_that_is_not_reached_is_named(certificate):
    assert certificate.unmet({"friction": 0.01}) == []
    assert certificate.unmet({"friction": 0.003, "backlash": 0.1}) == [
        "friction has sigma 0.0040, 0.003 is wanted",
        "backlash is not shown, sigma 0.1 is wanted",
    ]


def test_record_has_plain_values_and_none_for_what_is_not_known(certificate):
    record = certificate.record()
    assert record["faults"][BACKLASH]["sigma"] is None
    assert record["healthy_speed_rms"] is None
    assert record["faults"][0]["half_width"] == pytest.approx(HALF_WIDTH * 0.004)
    assert record["causes"][0] == {"name": "torque_constant", "size": 0.05, "verdict": "named"}
