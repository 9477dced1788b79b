# SPDX-License-Identifier: Apache-2.0
"""``ema lives``: folders of bags and files of estimates by seed, and refused options."""

import json
import signal
import subprocess
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest

from ema_bags import read_telemetry
from ema_bags.reader import Bag
from ema_cli import simulated_lives as making
from ema_core.faults import FAULT_NAMES
from ema_monitor.calibrations import CALIBRATION_FILE
from ema_monitor.health import HealthLimits
from ema_sim.lives import LifeSettings, constant_life, run_to_failure

from ..waiting import DEADLINE_S, started, wait_for

HERE = ("--executor", "threads", "--workers", "1")
"""Options that simulate lives in this process, whose functions are patched."""

FEW = LifeSettings(interval_hours=150.0, least_tests=4, most_tests=14, disturbed_share=0.5)
FEWER = replace(FEW, most_tests=4)


@pytest.fixture(scope="module")
def short():
    """Make lives of about seven tests; half of the tests have disturbed windows."""

    def run(limits, rng, kind, *, with_repair):
        return run_to_failure(limits, rng, kind, FEW, with_repair=with_repair)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(making, "run_to_failure", run)
        patch.setattr(making, "constant_life", partial(constant_life, settings=FEWER))
        yield


@pytest.fixture(scope="module")
def two_lives(ema, tmp_path_factory, short):
    """Return two lives as folders of bags."""
    folder = tmp_path_factory.mktemp("two") / "lives"
    result = ema("lives", *HERE, "-o", folder, "--count", "2", "--seed", "5", "--fault", "backlash")
    assert result.exit_code == 0, result.output
    return folder


def test_life_is_a_folder_with_a_bag_per_test(two_lives):
    folder = two_lives
    index = pd.read_csv(folder / "lives.csv")
    assert list(index["life"]) == ["life_0000", "life_0001"]
    assert set(index["dominant_fault"]) == {"backlash"}
    limit = HealthLimits().backlash
    for life in index.to_dict("records"):
        bags = sorted((folder / life["life"]).glob("*.mcap"))
        assert len(bags) == life["tests"] - life["missing"]
        stamps, values = [], []
        for path in bags:
            bag = Bag(path)
            assert bag.damage == ""
            messages = {
                name: item.message
                for name in ("usage", "simulated_faults")
                for item in bag.messages([f"/ema/{name}"])
            }
            usage, truth = messages["usage"], messages["simulated_faults"]
            number = int(path.stem.removeprefix("test_"))
            assert usage.flight_hours == 150.0 * number
            assert usage.cycles == number + 1
            assert usage.header.stamp.sec == 3600 * usage.flight_hours
            stamps.append(truth.header.stamp.sec)
            values.append(truth.faults.backlash)
        assert np.all(np.diff(stamps) > 0)
        assert np.all(np.diff(values) > 0.0)
        assert values[-1] < limit


def test_calibration_of_each_life_fits_its_unit(ema, two_lives):
    folder = two_lives
    names = list(pd.read_csv(folder / "lives.csv")["serial_number"])
    assert names == ["SIM-0001-5-0000", "SIM-0001-5-0001"]
    life = folder / "life_0001"
    result = ema("predict", life)
    assert f"flap ({names[1]})" in result.stdout
    assert str(life / CALIBRATION_FILE) in result.stdout
    # Half of the windows are disturbed; no other window is refused.
    assert "serial number" not in result.stderr
    both = ema("predict", folder / "life_0000", folder / "life_0001")
    assert both.exit_code == 1
    for part in (*names, "expected bags of a single unit"):
        assert part in both.stderr
    above = ema("predict", folder)
    assert above.exit_code == 1
    assert f"{folder / 'life_0000'}, {folder / 'life_0001'}: select one of these" in above.stderr


def test_estimates_hold_truth_and_covariance(ema, tmp_path, short):
    options = ("--fault", "friction", "--as", "estimates", "--seed", "2")
    result = ema("lives", *HERE, "-o", tmp_path / "lives", *options)
    assert result.exit_code == 0, result.output
    written = (tmp_path / "lives" / "life_0000.jsonl").read_text()
    lines = [json.loads(line) for line in written.splitlines()]
    windows = {line["window"] for line in lines}
    assert windows == {"good", "noisy", "gap"}
    for line in lines:
        assert list(line) == [
            "test", "hours", "window", "valid", "reason", "truth", "faults", "covariance",
            "unobservable", "goodness_of_fit",
        ]  # fmt: skip
        assert set(line["truth"]) == set(FAULT_NAMES)
        # Noise increases the standard deviations; little of the departure stays unexplained.
        assert line["valid"] or line["window"] != "good"
        if line["window"] == "gap":
            assert "gap of 300 samples" in line["reason"]
        if line["valid"]:
            sigma = np.sqrt(line["covariance"][0][0])
            error = line["faults"]["friction"] - line["truth"]["friction"]
            # The widest of a handful of errors; the estimator's floor is a few thousandths.
            assert abs(error) < 5.0 * sigma + 2e-3


@pytest.fixture(scope="module")
def constant(ema, tmp_path_factory, short):
    """Return a function that makes lives without growth, of four tests each."""

    def make(*arguments):
        folder = tmp_path_factory.mktemp("constant") / "lives"
        result = ema("lives", *HERE, "-o", folder, "--constant", *arguments)
        assert result.exit_code == 0, result.output
        return folder

    return make


def test_seed_determines_each_life_and_constant_ones_have_no_end(constant):
    folders = [
        constant("--as", "estimates", "--seed", seed, "--count", count)
        for seed, count in ((2, 1), (2, 2), (8, 1))
    ]
    first, same, changed = ((folder / "life_0000.jsonl").read_text() for folder in folders)
    assert first == same != changed
    index = pd.read_csv(folders[1] / "lives.csv")
    assert index[["end_hours", "dominant_fault"]].isna().all(axis=None)


def test_parallel_lives_equal_serial_ones(ema, tmp_path, short, two_lives):
    options = ("--count", "2", "--seed", "5", "--fault", "backlash", "--executor", "threads")
    result = ema("lives", "-o", tmp_path / "lives", *options, "--workers", "2")
    assert result.exit_code == 0, result.output
    one_by_one = two_lives / "lives.csv"
    assert (tmp_path / "lives" / "lives.csv").read_text() == one_by_one.read_text()
    for bag in two_lives.rglob("*.mcap"):
        copy = tmp_path / "lives" / bag.relative_to(two_lives)
        telemetry = [
            [block.current.tobytes() for block in read_telemetry(path)] for path in (bag, copy)
        ]
        assert telemetry[0] == telemetry[1]


def test_life_begins_at_the_given_time(ema, tmp_path, constant):
    folders = [constant("--start", start) for start in ("1970-01-01", "2026-03-01T06:00:00")]
    bags = [sorted((folder / "life_0000").glob("*.mcap")) for folder in folders]
    later_ns = {
        (Bag(late).start_ns or 0) - (Bag(early).start_ns or 0)
        for early, late in zip(*bags, strict=True)
    }
    assert later_ns == {1_772_344_800_000_000_000}
    result = ema("lives", *HERE, "-o", tmp_path / "lives", "--start", "2037-12-31")
    assert result.exit_code == 1
    assert "stamps end on 2038-01-18: expected a date from 1970-01-01 to 203" in result.stderr


def test_repair_is_reported(ema, tmp_path, short):
    folder = tmp_path / "lives"
    ema("lives", *HERE, "-o", folder, "--repair", "--fault", "gain", "--as", "estimates")
    [life] = pd.read_csv(folder / "lives.csv").to_dict("records")
    assert 0.0 < life["repair_hours"] < life["end_hours"]


def test_interrupted_command_leaves_only_complete_lives(tmp_path):
    folder = tmp_path / "lives"
    with started(
        ["ema", "lives", "-o", folder, "--count", "100"], stderr=subprocess.PIPE, text=True
    ) as process:
        wait_for(lambda: len(list(folder.glob("life_0000.part/*"))) >= 3, "a life")
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1
    assert error.splitlines()[-1] == f"Error: stopped: 0 of 100 lives are complete in {folder}"
    assert list(folder.iterdir()) == []
