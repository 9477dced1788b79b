"""An estimate survives JSON exactly."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from ema_core.causes import CauseEstimate
from ema_core.faults import FAULT_NAMES, FaultVector
from ema_monitor.identification.estimate import (
    Estimate,
    estimate_of,
    estimate_record,
)

from .windows import refused

RNG = np.random.default_rng(3)
ROOT = RNG.standard_normal((8, 8))
ESTIMATE = Estimate(
    2**62 + 1,
    2**62 + 500_000_001,
    "least_squares",
    7,
    "some-calibration",
    FaultVector.of(RNG.random(8)),
    ROOT @ ROOT.T,
    np.arange(8) == 5,
    play=-0.0,
    fitness=5e-324,
    goodness_of_fit=float("nan"),
    goodness_limit=float("inf"),
    excitation=1.0 / 3.0,
    evaluations=200,
    computing_time_s=0.1 + 0.2,
    valid=True,
    reason="Größe",
    insignificant=np.arange(8) == 2,
    warm_start=True,
    calibration_windows=4,
    verdict="degraded",
    unexplained_share=1.0 / 7.0,
    causes=(CauseEstimate("load_torque", 0.1 + 0.2, 1e-300), CauseEstimate("inertia", -0.05, 0.01)),
    alternatives=(("inertia", "torque constant"), ("gain", "speed sensor gain")),
    measured=(CauseEstimate("winding_temperature", 40.0, 1.0 / 3.0),),
)


@pytest.mark.parametrize(
    "estimate",
    [ESTIMATE, replace(ESTIMATE, play=np.float64(0.3)), refused("x")],
)
def test_every_field_comes_back_to_the_last_bit(estimate: Estimate):
    text = json.dumps(estimate_record(estimate), allow_nan=False)
    again = estimate_of(json.loads(text))
    for item in fields(Estimate):
        one, other = getattr(estimate, item.name), getattr(again, item.name)
        if item.type is float or isinstance(one, np.ndarray | FaultVector):
            # NaN has many bit patterns; everything else is compared bit by bit.
            one, other = (np.where(np.isnan(x), 0.0, x) for x in (one, other))
            assert one.tobytes() == other.tobytes(), item.name
            assert one.dtype == other.dtype
        else:
            assert (type(one), one) == (type(other), other)


def test_component_that_is_unobservable_is_not_called_healthy():
    unknown = np.arange(len(FAULT_NAMES)) == 0
    one = replace(
        ESTIMATE, unobservable=unknown, insignificant=np.ones(len(FAULT_NAMES), dtype=bool)
    )
    assert one.meanings[0] == "not shown"
    assert set(one.meanings[1:]) == {"healthy (not significant)"}


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        (CauseEstimate("inertia", -0.05, 0.01), "inertia -5 ± 1 %"),
        (CauseEstimate("current_offset", 0.1, 0.012), "current sensor offset +0.1 ± 0.012 A"),
    ],
)
def test_cause_is_told_in_its_unit_and_relative_ones_in_percent(cause, said):
    assert str(cause) == said


def test_faults_and_flags_are_by_name():
    record = estimate_record(ESTIMATE)
    assert list(record["faults"]) == list(FAULT_NAMES)
    assert record["unobservable"] == [FAULT_NAMES[5]]
    assert record["goodness_of_fit"] is None


@pytest.mark.parametrize("name", ["fitness", "covariance", "faults", "end_ns"])
def test_record_without_a_field_is_refused(name: str):
    record = estimate_record(ESTIMATE)
    del record[name]
    with pytest.raises((ValueError, KeyError), match=name):
        estimate_of(record)
