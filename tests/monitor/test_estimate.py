# SPDX-License-Identifier: Apache-2.0
"""An estimate survives JSON exactly; its window is shown with the response of the model."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from ema_core.causes import CauseEstimate
from ema_core.faults import FAULT_NAMES, FaultVector, fault_vector, healthy_faults
from ema_monitor.identification.alternatives import Alternative
from ema_monitor.identification.estimate import Estimate, Verdict, estimate_of, estimate_record
from ema_monitor.identification.window_fit import MOST_VALUES, window_fit
from ema_monitor.joint.window_figures import CommandedMotion, WindowFigures
from ema_monitor.reason_texts import EQUAL_SHORTS
from ema_monitor.reasons import CauseFound, NotSeparated, PoorFit, StatedReason, Subject
from ema_monitor.windows.band import rms

from .comparisons import CASES as COMPARISONS
from .comparisons import STILL, compared
from .reference_cases import CASES
from .windows import refused

RNG = np.random.default_rng(3)
ROOT = RNG.standard_normal((8, 8))
PART = WindowFigures(
    CommandedMotion(0.04, 3.0, 1.0), {"rest_current": 0.3, "current_forward": 0.7}, 750
)
ESTIMATE = Estimate(
    2**62 + 1,
    2**62 + 500_000_001,
    "least_squares",
    7,
    "some-calibration",
    FaultVector.of(RNG.random(8)),
    ROOT @ ROOT.T,
    np.arange(8) == 5,
    play_offset=-0.0,
    fitness=5e-324,
    goodness_of_fit=float("nan"),
    goodness_limit=float("inf"),
    excitation=1.0 / 3.0,
    evaluations=200,
    computing_time=0.1 + 0.2,
    valid=True,
    reasons=(
        StatedReason("Größe"),
        PoorFit(0.1 + 0.2, float("inf"), 1.0 / 7.0),
        NotSeparated(Subject.MOTION, ("inertia",), (EQUAL_SHORTS, ("gain",))),
        CauseFound("inertia", -0.05, 0.01, -0.06, 1e-300, stretches=2, of_stretches=3),
    ),
    insignificant=np.arange(8) == 2,
    warm_start=True,
    calibration_windows=4,
    verdict=Verdict.DEGRADED,
    unexplained_share=1.0 / 7.0,
    causes=(CauseEstimate("load_torque", 0.1 + 0.2, 1e-300), CauseEstimate("inertia", -0.05, 0.01)),
    alternatives=(Alternative(("inertia",), EQUAL_SHORTS), Alternative(("gain",), ("speed_gain",))),
    measured=(CauseEstimate("winding_temperature", 40.0, 1.0 / 3.0),),
)


@pytest.mark.parametrize(
    "estimate",
    [ESTIMATE, replace(ESTIMATE, play_offset=np.float64(0.3), parts=(PART,)), refused("x")],
)
def test_every_field_is_restored_exactly(estimate: Estimate):
    text = json.dumps(estimate_record(estimate), allow_nan=False)
    again = estimate_of(json.loads(text))
    for item in fields(Estimate):
        expected, actual = getattr(estimate, item.name), getattr(again, item.name)
        if item.type is float or isinstance(expected, np.ndarray | FaultVector):
            # NaN has many bit patterns; everything else is compared bit by bit.
            expected, actual = (np.where(np.isnan(x), 0.0, x) for x in (expected, actual))
            assert expected.tobytes() == actual.tobytes(), item.name
            assert expected.dtype == actual.dtype
        else:
            assert (type(expected), expected) == (type(actual), actual)


@pytest.mark.parametrize("name", COMPARISONS)
def test_comparison_is_restored_from_json(name: str):
    text = json.dumps(estimate_record(compared(COMPARISONS[name])), allow_nan=False)
    again = estimate_of(json.loads(text)).comparison
    # NaN differs from NaN, but its text does not.
    assert repr(again) == repr(COMPARISONS[name])


def test_record_of_an_earlier_version_has_no_comparison():
    record = estimate_record(ESTIMATE)
    del record["comparison"], record["parts"], record["lacks_calibration"]
    assert estimate_of(record).comparison is None
    assert not estimate_of(record).lacks_calibration


def test_record_with_an_unknown_reason_is_refused():
    with pytest.raises(ValueError, match="code = 'rust': expected one of "):
        estimate_of(estimate_record(ESTIMATE) | {"reasons": [{"code": "rust"}]})


def test_verdict_is_a_plain_string_in_records_and_rows():
    assert type(estimate_record(ESTIMATE)["verdict"]) is type(ESTIMATE.as_row()["verdict"]) is str
    assert estimate_of(estimate_record(ESTIMATE)).verdict is Verdict.DEGRADED
    with pytest.raises(ValueError, match="'doubtful' is not a valid Verdict"):
        estimate_of(estimate_record(ESTIMATE) | {"verdict": "doubtful"})


@pytest.mark.parametrize(
    "alternative", [["friction", "gain"], {"part": []}, {"part": ["rust"], "stand_in": ["gain"]}]
)
def test_record_with_an_unknown_alternative_is_refused(alternative):
    record = estimate_record(ESTIMATE) | {"alternatives": [alternative]}
    with pytest.raises((ValueError, KeyError)):
        estimate_of(record)


def test_comparison_is_printed_in_place_of_the_faults():
    text = str(compared(COMPARISONS["friction"]))
    assert "+15.2 %" in text
    assert "short circuit" not in text
    assert f"not judged ({STILL})" in str(compared(COMPARISONS["nothing"]))


def test_unobservable_component_is_not_called_healthy():
    unknown = np.arange(len(FAULT_NAMES)) == 0
    varied = replace(
        ESTIMATE, unobservable=unknown, insignificant=np.ones(len(FAULT_NAMES), dtype=bool)
    )
    assert varied.meanings[0] == "not shown"
    assert set(varied.meanings[1:]) == {"healthy (not significant)"}


@pytest.mark.parametrize(
    ("cause", "text"),
    [
        (CauseEstimate("inertia", -0.05, 0.01), "inertia -5 ± 1 %"),
        (CauseEstimate("current_offset", 0.1, 0.012), "current sensor offset +0.1 ± 0.012 A"),
    ],
)
def test_cause_is_shown_in_its_unit_and_relative_causes_in_percent(cause, text):
    assert str(cause) == text


def test_faults_and_flags_are_keyed_by_name():
    record = estimate_record(ESTIMATE)
    assert list(record["faults"]) == list(FAULT_NAMES)
    assert record["unobservable"] == [FAULT_NAMES[5]]
    assert record["goodness_of_fit"] is None
    # A fault within its standard deviation is not significant in any output.
    faults = np.add(healthy_faults(), 0.9 * np.asarray(ESTIMATE.sigma))
    varied = replace(ESTIMATE, faults=FaultVector.of(faults))
    assert {*estimate_record(varied)["insignificant"]} == {*FAULT_NAMES} - {"eccentricity_phase"}


@pytest.mark.parametrize("name", ["fitness", "covariance", "faults", "end_ns"])
def test_record_without_a_field_is_refused(name: str):
    record = estimate_record(ESTIMATE)
    del record[name]
    with pytest.raises((ValueError, KeyError), match=name):
        estimate_of(record)


@pytest.fixture(scope="module")
def window(windows_of):
    return windows_of(CASES["friction low"])[0]


@pytest.fixture
def estimate(estimates):
    return estimates("friction low")


def test_values_are_means_of_the_samples_at_their_time(window, estimate, calibration):
    fit = window_fit(window, estimate, calibration)
    each = round(fit.period / window.sample_period)
    assert len(fit.current) <= MOST_VALUES < len(fit.current) * 2
    assert fit.current[3] == pytest.approx(np.mean(window.current[3 * each : 4 * each]))
    assert fit.position[0] == pytest.approx(np.mean(window.telemetry.position[1 : each + 1]))
    # The first value is the mean from sample 1 on, and is placed at the middle of these samples.
    assert fit.start == pytest.approx(window.sample_period * (each + 1) / 2)


def test_model_at_the_estimate_is_closer_to_the_window_than_a_wrong_one(
    window, estimate, calibration
):
    fit = window_fit(window, estimate, calibration)
    wrong = replace(estimate, faults=type(estimate.faults).of(fault_vector({})))
    wrong_fit = window_fit(window, wrong, calibration)
    # Friction of 0.25 changes the current by much more than noise and model mismatch do.
    assert 3.0 * rms(fit.current - fit.estimated_current) < rms(
        wrong_fit.current - wrong_fit.estimated_current
    )
    assert rms(fit.speed - fit.estimated_speed) < 0.1 * rms(fit.speed)


def test_refused_window_shows_the_measurement_and_no_model(window, calibration):
    fit = window_fit(window, refused("too much noise"), calibration)
    assert np.isfinite(fit.current).all()
    assert np.isnan(fit.estimated_current).all()
    assert np.isnan(fit.estimated_speed).all()


@pytest.mark.parametrize(
    ("name", "value"), [("load_torque", 0.05), ("command_delay", 1e-3), ("position_gain", 0.05)]
)
def test_hidden_causes_are_part_of_the_expected_response(
    window, estimate, calibration, name, value
):
    cause = CauseEstimate(name, value, 1e-4)
    without = window_fit(window, estimate, calibration)
    with_it = window_fit(window, replace(estimate, causes=(cause,)), calibration)
    assert rms(with_it.estimated_current - without.estimated_current) > 1e-3
