# SPDX-License-Identifier: Apache-2.0
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from ema_bags.actuator_bag import SimulatedActuatorBag
from ema_bags.writer import BagWriter
from ema_cli.bags.predicting import Predicting
from ema_cli.bags.reading import ReadingOptions
from ema_cli.bags.unit_course import (
    Course,
    UnitRecord,
    find_bags,
    follow,
    read_unit,
    true_remaining_life,
)
from ema_cli.commands import predict as command
from ema_cli.figures.prognosis import draw_course
from ema_cli.show.prognosis_table import as_values, summary
from ema_cli.simulated_lives import LifeTest, simulated_tests, write_test
from ema_core.description import ActuatorDescription
from ema_core.faults import FAULT_NAMES, FaultVector, fault_vector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import CALIBRATION_FILE
from ema_monitor.identification.estimate import Estimate
from ema_monitor.prognosis.history_entry import Count
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reports import health_report
from ema_ros.actuator_messages import usage_at_cycle
from ema_ros.messages import StampedFaults
from ema_sim.lives import SimulatedLife, WindowKind

from ..prognosis.made_tests import SIGMA, made_test
from .conftest import INTERVAL_H, RATE, TESTS

NS_PER_HOUR = 3_600_000_000_000


@pytest.fixture(scope="module")
def reported(ema, life_folder, tmp_path_factory):
    picture = tmp_path_factory.mktemp("reported") / "life.png"
    result = ema("predict", life_folder, "--json", "-o", picture)
    assert (result.exit_code, result.stderr) == (0, "")
    assert picture.stat().st_size > 20_000
    return json.loads(result.stdout)


def estimate_of(hours: float, seed: int | None = None, friction: float = 0.0) -> Estimate:
    """Return the estimate at a service hour; with a seed, its errors have a sigma of 0.003."""
    made = made_test(0, friction=friction)
    k = fault_vector({"friction": friction})
    if seed is not None:
        rng = np.random.default_rng([seed, round(hours)])
        k = np.clip(k + 0.003 * rng.standard_normal(8) * (k != fault_vector({})), 0.0, 0.99)
    end_ns = round(hours * NS_PER_HOUR)
    return replace(
        made,
        start_ns=end_ns - 500_000_000,
        end_ns=end_ns,
        faults=FaultVector.of(k),
        covariance=(0.003 / SIGMA) ** 2 * made.covariance,
    )


def course_of(
    estimates: list[Estimate],
    settings: PrognosisSettings | None = None,
    *,
    counted: bool = True,
    truths: list[StampedFaults] | None = None,
) -> Course:
    counts = [Count(estimate.end_ns, estimate.end_ns / NS_PER_HOUR, 0) for estimate in estimates]
    record = UnitRecord(ActuatorDescription(), [], counts if counted else [], truths or [], [])
    predicting = Predicting(prognosis=settings or PrognosisSettings())
    return follow(record, estimates, Calibration.builtin(), predicting)


def growing(rate: float, tests: int, seed: int | None = None) -> list[Estimate]:
    return [
        estimate_of(hours, seed, friction=0.05 + rate * hours)
        for hours in INTERVAL_H * np.arange(1, tests + 1)
    ]


def test_folder_is_read_in_order_of_stamps_with_its_usage(reported):
    assert [test["flight_hours"] for test in reported["tests"]] == pytest.approx(
        list(INTERVAL_H * np.arange(1, TESTS + 1))
    )
    assert reported["flight_hours"] == pytest.approx(INTERVAL_H * TESTS)
    assert reported["cycles"] == TESTS
    friction = next(item for item in reported["faults"] if item["name"] == "friction")
    # Here, the estimator errs by 0.3 % of the range.
    assert friction["value"] == pytest.approx(0.28, abs=0.01)
    assert friction["trend"] == pytest.approx(RATE / INTERVAL_H, rel=0.15)
    # Friction reaches 0.5 in 110 h, if it continues to grow linearly.
    life = friction["rul"]
    assert life["known"]
    assert life["hours_05"] < 110.0 < life["hours_95"]
    assert life["cycles_50"] == pytest.approx(life["hours_50"] / INTERVAL_H)
    assert reported["rul"]["hours_50"] <= reported["rul_faults"]["hours_50"]


def test_json_is_the_health_message_and_every_test(reported):
    course = course_of(growing(1e-3, 1))
    message = health_report(course.outlooks[-1], course.record.description.unit_key)
    fields = set(as_values(message))
    assert set(reported) == fields | {"tests"}
    assert [item["name"] for item in reported["faults"]] == [
        name for name in FAULT_NAMES if name != "eccentricity_phase"
    ]
    assert [item["name"] for item in reported["requirements"]] == [
        "tracking_error", "bandwidth", "free_play", "torque_margin",
    ]  # fmt: skip
    assert all(test["valid"] for test in reported["tests"])
    assert reported["assumption"] == "future use as in the past"


@pytest.mark.slow
def test_past_predictions_are_reported_with_the_fault_that_ends_life():
    course = course_of(growing(8e-4, 50, seed=3))
    message = health_report(course.outlooks[-1], course.record.description.unit_key)
    friction = next(item for item in message.faults if item.name == "friction")
    # The 50 tests have five predictions twenty tests ahead; their law is in the bank.
    assert friction.score_rms == pytest.approx(1.0, abs=0.3)
    assert friction.score_rms_ahead < 1.5
    assert 1.0 <= friction.widening < 1.3
    assert math.isnan(next(iter(message.requirements)).widening)
    [line] = [
        sentence
        for sentence in summary(course, message)
        if sentence.startswith("calibration of predictions")
    ]
    assert f"friction {friction.score_rms:.2f} for the next test" in line
    assert f"{friction.score_rms_ahead:.2f} for 20 tests ahead" in line


def test_prediction_begins_at_the_last_test_with_plausible_hours():
    estimates = growing(2e-3, 20, seed=7)
    counts = [Count(item.end_ns, item.end_ns / NS_PER_HOUR, 0) for item in estimates[:-1]]
    counts.append(Count(estimates[-1].end_ns, 50_000.0, 0))
    record = UnitRecord(ActuatorDescription(), [], counts, [], [])
    course = follow(record, estimates, Calibration.builtin(), Predicting())
    assert not course.outlooks[-1].rul.known
    figure = draw_course(course)
    axes = figure.axes
    future = [
        line
        for item in axes
        for line in item.lines
        if line.get_label() == "predicted, median" and item is not axes[0]
    ]
    assert future
    for line in future:
        assert np.asarray(line.get_xdata())[0] == INTERVAL_H * 19
    assert axes[0].get_xlim()[0] == INTERVAL_H
    assert INTERVAL_H * 19 < axes[0].get_xlim()[1] < INTERVAL_H * 25
    # Even a long reason stays within the picture.
    figure.draw_without_rendering()
    title = next(text for text in axes[0].findobj(Text) if "service hours" in text.get_text())
    assert title.get_window_extent().x1 < figure.bbox.x1


def test_true_end_is_the_hour_at_which_the_first_limit_is_crossed():
    # Friction of 0.05 + 0.0031 u reaches 0.5 at 145.16 h, between two tests. It violates none of
    # the default requirements.
    estimates = growing(3.1e-3, 17)
    truths = [
        StampedFaults(e.start_ns, "flap", i, np.array(e.faults)) for i, e in enumerate(estimates)
    ]
    course = course_of(estimates, truths=truths)
    left = true_remaining_life(course)
    hours = np.array([outlook.flight_hours for outlook in course.outlooks])
    assert left == pytest.approx(np.maximum(0.45 / 3.1e-3 - hours, 0.0), abs=1e-6)
    # The picture marks the crossing at the limit, and not the last test at 170 h.
    friction = next(
        artist for artist in draw_course(course).axes if artist.get_ylabel() == "friction"
    )
    [end] = [
        np.asarray(artist.get_xdata()) for artist in friction.lines if artist.get_marker() == "D"
    ]
    assert end == pytest.approx([145.2], abs=4.0)
    # A healthy unit has 0.65 of its torque in reserve: a requirement of 0.6 ends life sooner.
    strict = PrognosisSettings(requirements=RequirementLimits(torque_margin=0.6))
    sooner = true_remaining_life(course_of(estimates, strict, truths=truths))
    assert 0.0 < sooner[0] < left[0] - INTERVAL_H


@pytest.mark.parametrize("counted", [True, False])
def test_picture_shows_what_ends_life_and_the_events(tmp_path, counted):
    estimates = growing(1.5e-3, 14, seed=6)
    estimates += [
        estimate_of(140.0 + INTERVAL_H * i, 6, friction=0.02 + 1.5e-3 * INTERVAL_H * i)
        for i in range(1, 13)
    ]
    course = course_of(estimates, counted=counted)
    figure = draw_course(course)
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"estimate, 90 % interval", "tracked", "limit"} <= labels
    assert len(labels) <= 8
    assert ("event" in labels) == counted
    assert ("predicted: median, 5 to 95 %" in labels) == counted
    title = figure.axes[0].get_title(loc="left")
    assert ("service hours are unknown" in title) == (not counted)
    figure.savefig(tmp_path / "picture.png")


def test_prognosis_at_an_earlier_hour_leaves_out_later_tests(ema, life_folder, reported):
    earlier = json.loads(ema("predict", life_folder, "--at", "75", "--json").stdout)
    assert earlier["flight_hours"] == 70.0
    assert earlier["tests"] == reported["tests"][:7]
    refused = ema("predict", life_folder, "--at", "5")
    assert (refused.exit_code, "--at 5" in refused.stderr) == (1, True)


def test_disturbed_test_does_not_change_the_exit_code_of_a_good_prognosis(ema, written, tmp_path):
    written("one.mcap")
    Calibration.builtin().save(tmp_path / CALIBRATION_FILE)
    written("two.mcap", 2.0, window="gap")
    result = ema("predict", tmp_path)
    assert "no valid estimate" in result.stderr
    assert "1 valid of 2 tests" in result.stdout
    assert "level STALE (last OK)" in result.stdout
    assert "the newest test was refused: gap of" in result.stdout
    assert result.exit_code == 0


def test_table_reports_each_fault_and_requirement_and_both_ends_of_life(ema, life_folder):
    result = ema("predict", life_folder, "--duty", "2")
    assert result.exit_code == 0
    for words in (
        "friction", "backlash", "bandwidth", "torque margin", "by faults", "by requirements",
        "the earlier", "health index", "growth factor 2", "service hours 100",
        "10 valid of 10 tests",
    ):  # fmt: skip
        assert words in result.stdout


def one_test(
    description: ActuatorDescription, hours: float = 1.0, window: WindowKind = "good"
) -> LifeTest:
    """Return a healthy test of a unit."""
    life = SimulatedLife("", {}, np.array([hours]), fault_vector({})[None], (window,), math.inf)
    [test] = simulated_tests(life, description, np.random.default_rng(0))
    return test


@pytest.fixture
def written(tmp_path) -> Callable[..., Path]:
    """Return a function that writes one test of another unit to a bag."""

    def write(
        name: str,
        hours: float = 1.0,
        window: WindowKind = "good",
        *,
        counted: bool = True,
        **changes: str,
    ) -> Path:
        description = replace(ActuatorDescription(), **changes)
        test = one_test(description, hours, window)
        if counted:
            write_test(tmp_path / name, test, description)
        else:
            writer = BagWriter(tmp_path / name)
            with SimulatedActuatorBag(writer, description, test.start_ns) as bag:
                for block in test.blocks:
                    bag.write_block(block)
        return tmp_path / name

    return write


def test_reason_shared_by_all_tests_is_reported_once_with_its_remedy(ema, written):
    result = ema("predict", written("one.mcap"), "--limit", "friction=0.4")
    assert result.exit_code == 0
    # A single test may be an outlier.
    assert result.stdout.count("fewer than two tests agree so far") == 1
    silent = ema("predict", written("uncounted.mcap", counted=False))
    assert silent.exit_code == 0
    assert "--hours-per-cycle" in silent.stderr
    assert silent.stdout.count("no count was received on topic usage") == 1


def test_two_actuators_are_refused_by_name_unless_one_is_chosen(ema, written):
    flap, rudder = written("one.mcap"), written("other.mcap", 2.0, actuator_id="rudder")
    result = ema("predict", flap, rudder)
    assert result.exit_code == 1
    error = result.stderr.strip().splitlines()[-1]
    for part in (str(flap), str(rudder), "'rudder'", "--actuator-id"):
        assert part in error
    record = read_unit([flap, rudder], ReadingOptions("rudder"))
    assert record.description.actuator_id == "rudder"
    assert len(record.windows) == 1
    assert "skipped" in record.remarks[0]


def test_two_bags_whose_windows_overlap_are_refused(ema, tmp_path):
    """Windows of different commands end at different times; the order of the tests is unclear."""
    paths = [tmp_path / "swing.mcap", tmp_path / "chirp.mcap"]
    ema("simulate", "--command", "swing", "-o", paths[0])
    ema("simulate", "-o", paths[1])
    result = ema("predict", *paths)
    assert (result.exit_code, "which came first" in result.stderr) == (1, True)
    # The same bag given twice counts once.
    assert len(read_unit([paths[1]] * 2, ReadingOptions()).windows) == 1


def test_usage_of_another_unit_is_ignored_with_a_remark(tmp_path):
    description = ActuatorDescription()
    test = one_test(description)
    count = usage_at_cycle(replace(description, serial_number="0002"), test.start_ns, 500.0, 6)
    nameless = usage_at_cycle(description, test.start_ns + 1, 40.0, 7)
    nameless.serial_number = ""
    path = tmp_path / "one.mcap"
    with BagWriter(path) as writer, SimulatedActuatorBag(writer, description) as bag:
        for message in (count, count, nameless):
            writer.write("/ema/usage", message, test.start_ns)
        for block in test.blocks:
            bag.write_block(block)
    record = read_unit([path], ReadingOptions())
    assert [item.hours for item in record.counts] == [40.0]
    assert record.remarks == [f"{path}: usage of serial number '0002' is ignored"]


def test_usage_recorded_after_the_test_is_not_reported_as_missing(ema, tmp_path):
    description = ActuatorDescription()
    test = one_test(description)
    path = tmp_path / "one.mcap"
    with BagWriter(path) as writer, SimulatedActuatorBag(writer, description) as bag:
        for block in test.blocks:
            bag.write_block(block)
        late = test.start_ns + 60_000_000_000
        writer.write("/ema/usage", usage_at_cycle(description, late, 40.0, 7), late)
    result = ema("predict", path)
    assert (result.exit_code, result.stderr) == (0, "")
    assert "service hours unknown" in result.stdout
    assert "received on topic usage before the test" in result.stdout


def test_simulated_bag_reports_its_service_hours(ema, tmp_path):
    bag = tmp_path / "three.mcap"
    assert ema("simulate", "--cycles", "3", "-o", bag).exit_code == 0
    reported = json.loads(ema("predict", bag, "--json").stdout)
    assert [test["flight_hours"] for test in reported["tests"]] == [0.0, 10.0, 20.0]
    assert reported["cycles"] == 3


def test_impossible_usage_is_reported_and_not_used(tmp_path):
    description = ActuatorDescription()
    test = one_test(description)
    write_test(tmp_path / "one.mcap", replace(test, hours=-1.0), description)
    record = read_unit([tmp_path], ReadingOptions())
    assert record.counts == []
    assert "usage is impossible: flight_hours = -1 h" in record.remarks[0]


def test_folder_without_bags_names_its_subfolders_with_bags(tmp_path):
    with pytest.raises(ValueError, match="folder without bags") as refused:
        find_bags([tmp_path])
    assert "select one of these" not in str(refused.value)
    for number in range(5):
        (tmp_path / f"life_{number}").mkdir()
        if number != 1:
            (tmp_path / f"life_{number}" / "test.mcap").touch()
    named = ", ".join(str(tmp_path / f"life_{number}") for number in (0, 2, 3))
    with pytest.raises(ValueError, match="folder without bags") as refused:
        find_bags([tmp_path])
    assert f"{named} and 1 more: select one of these" in str(refused.value)


def test_calibration_next_to_the_bags_is_used(ema, written, tmp_path):
    bag = written("one.mcap", serial_number="0002")
    refused = ema("predict", bag)
    assert refused.exit_code == 3
    assert "serial number '0002'" in refused.stderr
    path = tmp_path / CALIBRATION_FILE
    replace(Calibration.builtin(), serial_number="0002").save(path)
    for argument in (bag, tmp_path):
        reported = ema("predict", argument)
        assert (reported.exit_code, reported.stderr) == (0, "")
        assert str(path) in reported.stdout
    for same in ("estimate", "compare"):
        reported = ema(same, bag)
        assert (reported.exit_code, str(path) in reported.stdout) == (0, True), reported.output
    copy = shutil.copy(bag, tmp_path / "copy.mcap")
    reported = ema("predict", bag, copy)
    assert reported.exit_code == 0
    assert reported.stderr == f"{copy}: skipped, a copy of {bag}\n"
    # A calibration on the command line takes precedence.
    named = tmp_path / "named.yaml"
    Calibration.builtin().save(named)
    assert ema("predict", bag, "--calibration", named).exit_code == 3


def test_two_calibrations_next_to_the_bags_are_ambiguous(ema, written, tmp_path):
    bags = []
    for hours, name in ((1.0, "a"), (2.0, "b")):
        (tmp_path / name).mkdir()
        Calibration.builtin().save(tmp_path / name / CALIBRATION_FILE)
        bags.append(written(f"{name}/test.mcap", hours))
    result = ema("predict", *bags)
    assert result.exit_code == 1
    assert "select one with --calibration" in result.stderr
    chosen = tmp_path / "a" / CALIBRATION_FILE
    assert ema("predict", *bags, "--calibration", chosen).exit_code == 0


@pytest.mark.parametrize("form", [(), ("--json",)])
def test_results_are_printed_even_if_the_picture_cannot_be_written(
    ema, written, monkeypatch, tmp_path, form
):
    def fail(course):
        raise OSError("no space left on device")

    monkeypatch.setattr(command, "draw_course", fail)
    result = ema("predict", written("one.mcap"), "-o", tmp_path / "life.png", *form)
    assert result.exit_code == 1
    assert "no space left on device" in result.stderr
    assert "health_index" in result.stdout if form else "health index" in result.stdout
