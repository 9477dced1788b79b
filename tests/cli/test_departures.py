# SPDX-License-Identifier: Apache-2.0
"""Departures of tests from the healthy windows of a calibration, and labelled states."""

import json

import numpy as np
import pandas as pd
import pytest

from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.estimate import Verdict
from ema_monitor.joint.window_figures import figures_of_row
from ema_monitor.prognosis.history import History, history_path
from ema_monitor.prognosis.history_entry import UnusedCycle

from .test_slow_records import MAPPING, written

QUIET, NOISY = ("--current-noise", "0.02"), ("--current-noise", "0.3")
DRY = (*QUIET, "--fault", "friction=0.3")
SLIDE = "actuator_id: slide\nserial_number: {}\nsample_period: 0.04\ndrive: unknown\n"


@pytest.fixture(scope="module")
def simulated(ema, tmp_path_factory):
    """Return a function that simulates tests of the built-in actuator and returns the bag."""
    folder = tmp_path_factory.mktemp("flap")

    def bag(name, seed, *options, cycles=1):
        path = folder / f"{name}.mcap"
        if not path.exists():
            counts = ("--cycles", str(cycles), "--seed", str(seed))
            assert ema("simulate", *counts, *options, "-o", path).exit_code == 0
        return path

    return bag


@pytest.fixture(scope="module")
def calibration(ema, simulated, tmp_path_factory):
    """Return the content of a calibration on twelve healthy windows of the built-in actuator."""
    path = tmp_path_factory.mktemp("calibration") / "flap.yaml"
    result = ema("calibrate", simulated("healthy", 0, *QUIET, cycles=12), "-o", path)
    assert result.exit_code == 0, result.output
    return path.read_text()


@pytest.fixture
def calibrated(calibration, tmp_path):
    path = tmp_path / "calibration.yaml"
    path.write_text(calibration)
    return path


def text_of(result):
    return " ".join(result.output.split())


def first(ema, bag, calibrated):
    result = ema("estimate", bag, "--calibration", calibrated, "--json")
    return json.loads(result.stdout)[0]


@pytest.mark.slow
def test_estimate_departs_if_no_fault_explains_the_change(ema, tmp_path, simulated, calibrated):
    command = ("--calibration", calibrated)
    result = ema("estimate", simulated("again", 11, *QUIET), *command)
    assert result.exit_code == 0, result.output
    noisy = simulated("noisy", 13, *NOISY)
    result = ema("estimate", noisy, *command)
    assert result.exit_code == 3, result.output
    assert "departed, goodness of fit" in text_of(result)
    assert "roughness of the current in the" in text_of(result)
    assert "no fault explains it" in text_of(result)
    assert first(ema, noisy, calibrated)["verdict"] == "departed"
    for again in (("predict", "--hours-per-cycle", "1"), ("report", "-o", tmp_path / "unit.html")):
        result = ema(again[0], noisy, *command, *again[1:])
        assert result.exit_code == 3, result.output
        assert "WARN" in text_of(result) or "Changed: departed" in text_of(result)
    result = ema("estimate", simulated("dry", 12, *DRY), *command)
    assert result.exit_code == 0, result.output
    assert "departed" not in result.output


@pytest.mark.slow
def test_loads_of_the_healthy_windows_are_distinguished(ema, tmp_path, simulated, calibrated):
    """A new load explains a current that departs; a load of the healthy windows does not."""
    load = ("--cause", "load_torque=0.02")
    loaded = simulated("loaded", 40, *QUIET, *load, cycles=4)
    both = tmp_path / "both.yaml"
    healthy = simulated("healthy", 0, *QUIET, cycles=12)
    assert ema("calibrate", healthy, loaded, "-o", both).exit_code == 0
    bags = (
        simulated("loaded_later", 50, *QUIET, *load),
        simulated("loaded_noisy", 51, *NOISY, *load),
    )
    departed = [
        first(ema, bag, calibration)["verdict"] == "departed"
        for calibration in (calibrated, both)
        for bag in bags
    ]
    assert departed == [False, False, False, True]


@pytest.mark.slow
def test_labelled_state_is_named_by_estimate_and_report(ema, tmp_path, simulated, calibrated):
    # Friction explains the first state, but not the second.
    for state, options, seed in (("dry", DRY, 60), ("worn screw", NOISY, 70)):
        some = [simulated(f"{state}{n}", seed + n, *options) for n in range(3)]
        result = ema("label", calibrated, *some, "--state", state)
        assert result.exit_code == 0, result.output
        assert f"3 tests {state}" in result.output
    command = ("--calibration", calibrated)
    result = ema("estimate", simulated("dry later", 90, *DRY), *command)
    assert result.exit_code == 0, result.output
    assert "the most probable labelled state is dry (" in text_of(result)
    later = simulated("noisy later", 90, *NOISY)
    result = ema("estimate", later, *command)
    assert result.exit_code == 3, result.output
    assert "the most probable labelled state is worn screw (" in text_of(result)
    page = tmp_path / "unit.html"
    assert ema("report", later, *command, "-o", page).exit_code == 3
    assert "the most probable labelled state is worn screw (" in page.read_text()
    for wrong, state, words in (
        (
            simulated("other", 1, "-p", "serial_number=S2"),
            "dry",
            "was made on 'SIM-0001': run `ema calibrate` for this unit",
        ),
        (later, "healthy", "use `ema calibrate` for healthy bags"),
    ):
        result = ema("label", calibrated, wrong, "--state", state)
        assert result.exit_code == 1
        assert words in " ".join(result.stderr.split())
    healthy = simulated("healthy", 0, *QUIET, cycles=12)
    result = ema("calibrate", healthy, "--replace", "-o", calibrated)
    assert "labelled states kept: dry, worn screw" in result.stdout
    # A history has the departures of its tests without the bags.
    path = history_path(tmp_path, "flap", "SIM-0001")
    figures = tuple(map(figures_of_row, first(ema, later, calibrated)["parts"]))
    history = History("flap", "SIM-0001", path)
    history.append(UnusedCycle(86_400 * 10**9, Verdict.DEPARTED, parts=figures))
    history.close()
    for test, words in (
        ("1", "3 tests dry, 4 tests worn screw"),
        ("1970-01-02", "3 tests dry, 4 tests worn screw"),
        (
            "2",
            (
                "expected number or date of a test; the last test, number 1, has the date "
                "1970-01-02T00:00:00"
            ),
        ),
    ):
        result = ema("label", calibrated, path, "--test", test, "--state", "worn screw")
        assert words in result.output
    assert ema("label", calibrated, later, "--test", "1", "--state", "dry").exit_code == 2
    result = ema("label", calibrated, "--remove", "dry")
    assert "12 tests healthy, 4 tests worn screw" in result.stdout


def test_history_is_labelled_only_with_chosen_tests(ema, tmp_path):
    calibration = Calibration.builtin()
    calibration.save(tmp_path / "calibration.yaml")
    unit = calibration.actuator_id, calibration.serial_number
    path = history_path(tmp_path, *unit)
    history = History(*unit, path)
    history.append(UnusedCycle(86_400 * 10**9, Verdict.DEPARTED))
    history.close()
    result = ema("label", tmp_path / "calibration.yaml", path, "--state", "dry")
    assert result.exit_code == 1
    assert (
        "select the tests of this state with --test NUMBER or --test DATE; the last test, number "
        "1, has the date 1970-01-02T00:00:00"
    ) in " ".join(result.stderr.split())


@pytest.fixture(scope="module")
def slides(ema, tmp_path_factory):
    """Return a function that imports records of slides with an unknown drive to a bag."""
    folder = tmp_path_factory.mktemp("slides")
    (folder / "mapping.yaml").write_text(MAPPING)

    def imported(name, *, serial="R1", seconds=60.0, **changes):
        bag = folder / f"{name}.mcap"
        if not bag.exists():
            (folder / f"{serial}.yaml").write_text(SLIDE.format(serial) + "parameters: {tau: 1}\n")
            table = written(folder / f"{name}.csv", 25, seconds, **changes)
            result = ema(
                *("import", table, "--mapping", folder / "mapping.yaml"),
                *("--actuator", folder / f"{serial}.yaml", "-o", bag),
            )
            assert result.exit_code == 0, result.output
        return bag

    return imported


@pytest.fixture(scope="module")
def healthy_slides(slides):
    return [slides(f"healthy{seed}", friction_a=0.6 + 0.002 * seed, seed=seed) for seed in range(5)]


def states_of(ema, bag, calibrated, *options):
    result = ema("estimate", bag, "--calibration", calibrated, *options, "--json")
    return json.loads(result.stdout)[0]["comparison"]["states"]


@pytest.mark.slow
def test_records_of_an_unknown_drive_are_labelled(ema, tmp_path, slides, healthy_slides):
    calibrated = tmp_path / "calibration.yaml"
    assert ema("calibrate", *healthy_slides, "-o", calibrated).exit_code == 0
    dry, rough = {"friction_a": 0.75}, {"current_noise": 0.06}
    for state, change, seed in (("dry", dry, 60), ("worn screw", rough, 70)):
        some = [slides(f"{state}{n}", seed=seed + n, **change) for n in range(3)]
        result = ema("label", calibrated, *some, "--state", state)
        assert result.exit_code == 0, result.output
        assert f"3 records {state}" in result.output
    for state, change in (("dry", dry), ("worn screw", rough), ("healthy", {})):
        later = slides(f"{state} later", seed=90, **change)
        assert next(iter(states_of(ema, later, calibrated))) == state
    # A record is labelled with the new state, and a further calibration keeps the states.
    result = ema("label", calibrated, slides("dry0", seed=60, **dry), "--state", "worn screw")
    assert "5 records healthy, 2 records dry, 4 records worn screw" in result.output
    result = ema("calibrate", *healthy_slides, "--replace", "-o", calibrated)
    assert "labelled states kept: dry, worn screw" in result.stdout
    result = ema("label", calibrated, "--remove", "dry")
    assert "5 records healthy, 4 records worn screw" in result.stdout
    history = History("slide", "R1", history_path(tmp_path, "slide", "R1"))
    history.close()
    for wrong, words in (
        (slides("other", serial="R2"), "was made on 'R1': run `ema calibrate` for this unit"),
        (healthy_slides[0], "it is one of the healthy records of the calibration"),
        (slides("short", seconds=8.0), "no record can be labelled:"),
        (history_path(tmp_path, "slide", "R1"), "do not contain the features of records"),
    ):
        result = ema("label", calibrated, wrong, "--state", "dry")
        assert result.exit_code == 1
        assert words in " ".join(result.stderr.split())


@pytest.mark.slow
def test_table_with_a_mapping_is_read_like_a_bag_and_labelled_by_its_columns(
    ema, tmp_path, slides, healthy_slides
):
    calibrated = tmp_path / "calibration.yaml"
    tables = [bag.with_suffix(".csv") for bag in healthy_slides]
    actuator = ("--actuator", tables[0].with_name("R1.yaml"))
    assert ema("calibrate", *tables, *actuator, "-o", calibrated).exit_code == 0
    frames = []
    for state, change in (("normal", {}), ("rough", {"current_noise": 0.06})):
        for number in range(3):
            made = slides(f"{state}{number}", seed=110 + number, **change).with_suffix(".csv")
            frames.append(pd.read_csv(made).assign(condition=state, trial=number))
    pd.concat(frames).to_csv(tmp_path / "all.csv", index=False)
    columns = ("--state-column", "condition", "--test-column", "trial")
    command = ("label", calibrated, tmp_path / "all.csv", *actuator, *columns)
    result = ema(*command)
    assert "all.csv is a table without a mapping " in result.stderr
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    result = ema(*command)
    assert "5 records healthy, 3 records rough" in result.stdout, result.output
    assert ema("label", calibrated).stdout == result.stdout
    later = slides("rough later", seed=90, current_noise=0.06).with_suffix(".csv")
    assert next(iter(states_of(ema, later, calibrated, *actuator))) == "rough"


def test_table_of_moves_is_tracked_to_its_limit(ema, tmp_path):
    rng = np.random.default_rng(0)
    days = pd.date_range("2026-01-01", periods=14)
    ratio = np.where(np.arange(14) < 6, 1.0, 1.0 + 0.08 * (np.arange(14) - 5))
    rows = [
        {
            "day": f"{day:%Y-%m-%d}",
            "serial": "A7",
            "hz": hz,
            "rms": hz * factor * rng.normal(1, 0.01),
        }
        for day, factor in zip(days, ratio, strict=True)
        for hz in (1.0, 2.0)
    ]
    pd.DataFrame(rows).to_csv(tmp_path / "moves.csv", index=False)
    mapping = tmp_path / "moves.yaml"
    mapping.write_text("time: day\nfigures: [rms]\nlike: [hz]\nunit: serial\n")
    command = ("moves", tmp_path / "moves.csv", "--mapping", mapping, "--limit", "1.5")
    result = ema(*command, "--json")
    assert result.exit_code == 3, result.output
    reported = json.loads(result.stdout)
    assert [factor["level"] for factor in reported] == [
        *["STALE"] * 5,
        *["OK"] * 1,
        *["WARN"] * 6,
        *["ERROR"] * 2,
    ]
    assert {factor["unit"] for factor in reported} == {"A7"}
    low, _, high = reported[9]["life_days"]
    assert low <= 2.25 <= high
    mapping.write_text("time: day\nfigures: [rmss]\n")
    result = ema(*command)
    assert result.exit_code == 1
    assert "rmss" in result.stderr


def test_calibration_of_another_unit_is_the_only_reason_stated(ema, tmp_path):
    healthy, case, calibration = (tmp_path / name for name in ("h.mcap", "c.mcap", "c.yaml"))
    ema("simulate", "--cycles", "6", "-p", "serial_number=S2", "-o", healthy)
    ema("simulate", "--fault", "friction=0.2", "--start", "2026-01-01", "-o", case)
    assert ema("calibrate", healthy, "-o", calibration).exit_code == 0
    result = ema("estimate", case, "--calibration", calibration, "--json")
    assert result.exit_code == 3
    reason = json.loads(result.stdout)[0]["reason"]
    assert reason.startswith("the calibration does not fit: the actuator has serial number")
