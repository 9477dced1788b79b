# SPDX-License-Identifier: Apache-2.0
"""Baseline of a unit: learning, acceptance, extension, reset, and kills during these."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_monitor.baselines.changes import ChangeKind, append_change, read_changes
from ema_monitor.baselines.unit_baseline import (
    MOST_CANDIDATES,
    MOST_RECORDS,
    InUseError,
    UnitBaseline,
    calibration_pattern,
    unit_folder,
)
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.reasons import Reason
from ema_ros.actuator_file import load_description

from .healthy import JOINT, record

HOLDER = """
import sys
from pathlib import Path
from ema_core.description import ActuatorDescription
from ema_monitor.baselines.unit_baseline import UnitBaseline
joint = ActuatorDescription("elbow/1", "7", sample_period=1e-2, drive="unknown")
with UnitBaseline(Path(sys.argv[1]), joint):
    print("held", flush=True)
    sys.stdin.read()
"""


def learned(folder: Path, count: int, **friction: float) -> UnitBaseline:
    baseline = UnitBaseline(folder, JOINT)
    for number in range(count):
        factor = friction.get(f"record_{number}", 1.0)
        baseline.add(record(number, day=number // 3, friction=factor))
    return baseline


def test_baseline_is_learned_accepted_and_matches_the_calibration_pattern(tmp_path: Path):
    with learned(tmp_path, 6) as baseline:
        assert not baseline.is_accepted
        assert baseline.is_fit_due
        baseline.fit()
        progress = baseline.progress(10)
        assert (progress.records, progress.days, progress.records_needed) == (6, 2, 10)
        assert progress.reason == ""
        # Friction scatters by 1 %: a few per cent are detectable on the same day, more on another
        # day.
        assert 0.02 < progress.detectable_same_day < progress.detectable_other_day < 0.4
        assert progress.forward_share == pytest.approx(0.5, abs=0.05)
        assert 0.5 < progress.slowest <= progress.fastest < 1.5
        assert progress.advice
        change = baseline.accept("Ada", "new gear")
        assert (change.kind, change.author, change.note) == (ChangeKind.ACCEPT, "Ada", "new gear")
        assert (change.before, change.records) == ("", 6)
        assert baseline.candidates == []
        assert baseline.accepted_by == change
    calibration = CalibrationStore(calibration_pattern(tmp_path), tmp_path).of(JOINT)
    assert not isinstance(calibration, Reason)
    assert calibration.calibration_id == change.after
    with UnitBaseline(tmp_path, JOINT) as again:
        assert again.is_accepted
        assert again.accepted_by == change
    described = load_description(unit_folder(tmp_path, "elbow/1", "7") / "description.yaml")
    assert described == JOINT


def test_few_records_make_no_baseline(tmp_path: Path):
    with learned(tmp_path, 2) as baseline:
        assert not baseline.is_fit_due
        assert "at least 3" in baseline.progress().reason
        with pytest.raises(ValueError, match="2 records: a baseline needs at least 3"):
            baseline.accept("Ada")
        assert baseline.changes == []


def test_departing_record_is_refused_unless_a_person_forces_it(tmp_path: Path):
    with learned(tmp_path, 8, record_4=1.6) as baseline:
        baseline.fit()
        assert "differs from the other healthy records" in baseline.progress().reason
        with pytest.raises(ValueError, match=r"refused: the record of .* differs"):
            baseline.accept("accept_after = 8", is_automatic=True)
        assert not baseline.is_accepted
        change = baseline.accept("Ada", "known payload", force=True)
        assert change.records == 8


def test_effort_without_friction_makes_no_baseline(tmp_path: Path):
    with UnitBaseline(tmp_path, JOINT) as baseline:
        for number in range(5):
            window = record(number)
            noise = np.random.default_rng(number).standard_normal(len(window.telemetry))
            baseline.add(replace(window, telemetry=replace(window.telemetry, current=noise)))
        with pytest.raises(ValueError, match="refused"):
            baseline.accept("Ada")
        assert baseline.progress().reason


def test_extension_adds_candidates_and_reset_keeps_the_history(tmp_path: Path):
    with learned(tmp_path, 5) as baseline:
        first = baseline.accept("Ada")
        with pytest.raises(ValueError, match="extend it, or reset it first"):
            baseline.accept("Ada")
        with pytest.raises(ValueError, match="nothing to extend the baseline with"):
            baseline.extend("Ada")
        before = baseline.progress().detectable_other_day
        for number in range(5, 9):
            baseline.add(record(number, day=number))
        assert not baseline.is_fit_due, "an accepted baseline is not extended by itself"
        assert len(baseline.candidates) == 4
        extended = baseline.extend("Bob", "four days")
        assert (extended.before, extended.records) == (first.after, 9)
        assert baseline.progress().detectable_other_day < before
        baseline.reset("Cy", "gear replaced")
        assert not baseline.is_accepted
        assert baseline.candidates == []
        with pytest.raises(ValueError, match="no accepted baseline"):
            baseline.extend("Bob")
    with UnitBaseline(tmp_path, JOINT) as again:
        kinds = [change.kind for change in again.changes]
        assert kinds == [ChangeKind.ACCEPT, ChangeKind.EXTEND, ChangeKind.RESET]
        assert again.progress().records == 0
        assert "gear replaced" in str(again.changes[-1])


@pytest.mark.slow
def test_numbers_of_records_are_limited(tmp_path: Path):
    with UnitBaseline(tmp_path, JOINT) as baseline:
        for number in range(MOST_RECORDS + 5):
            baseline.add(record(number))
        assert len(baseline.candidates) == MOST_RECORDS
        baseline.accept("Ada")
        for number in range(100, 100 + MOST_CANDIDATES + 5):
            baseline.add(record(number))
        assert len(baseline.candidates) == MOST_CANDIDATES
        assert baseline.extend("Ada").records == MOST_RECORDS
        assert baseline.candidates == []


def test_person_is_required(tmp_path: Path):
    with learned(tmp_path, 3) as baseline:
        for person in ("", "x" * 61, "\x00"):
            with pytest.raises(ValueError, match="person: expected"):
                baseline.accept(person)
        assert not baseline.is_accepted


def test_records_without_a_clock_count_as_one_day(tmp_path: Path):
    with UnitBaseline(tmp_path, JOINT, has_clock=False) as baseline:
        for number in range(4):
            baseline.add(record(number, day=number))
        baseline.fit()
        assert baseline.progress().days == 1
        baseline.accept("Ada")
        assert baseline.calibration is not None
        assert set(baseline.calibration.baseline.days) == {0}


def test_only_one_process_uses_a_baseline_and_its_kill_releases_it(tmp_path: Path):
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(InUseError, match="another process"):
            UnitBaseline(tmp_path, JOINT)
        holder.kill()
    UnitBaseline(tmp_path, JOINT).close()


class Killed(BaseException):
    """Raised in place of a kill at a chosen step."""


def kill(*_: object) -> None:
    raise Killed


@pytest.mark.parametrize("is_written", [False, True])
def test_kill_during_an_acceptance_leaves_all_or_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_written: bool
):
    """The history is written before the change takes effect, and opening completes the change."""
    baseline = learned(tmp_path, 4)
    place = "UnitBaseline._complete" if is_written else "append_change"
    with monkeypatch.context() as patch:
        patch.setattr(f"ema_monitor.baselines.unit_baseline.{place}", kill)
        with pytest.raises(Killed):
            baseline.accept("Ada")
    baseline.close()
    with UnitBaseline(tmp_path, JOINT) as again:
        assert again.is_accepted == is_written
        assert len(again.changes) == is_written
        assert len(again.candidates) == (0 if is_written else 4)


def test_kill_during_a_reset_is_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    baseline = learned(tmp_path, 4)
    baseline.accept("Ada")
    with monkeypatch.context() as patch:
        patch.setattr(UnitBaseline, "_discard", kill)
        with pytest.raises(Killed):
            baseline.reset("Ada")
    baseline.close()
    with UnitBaseline(tmp_path, JOINT) as again:
        assert not again.is_accepted
        assert again.candidates == []


def test_truncated_line_of_the_history_affects_no_other_line(tmp_path: Path):
    with learned(tmp_path, 3) as baseline:
        change = baseline.accept("Ada")
    file = unit_folder(tmp_path, "elbow/1", "7") / "changes.jsonl"
    with file.open("ab") as stream:
        stream.write(b'{"kind": "res')
    append_change(file, change)
    assert read_changes(file) == [change, change]
    assert json.loads(file.read_bytes().splitlines()[-1])["author"] == "Ada"


@pytest.mark.parametrize("damage", [b"", b"\x00\xff", b"format: joint_1\nactuator_id: el", None])
def test_damaged_calibration_is_fitted_again_from_its_records(tmp_path: Path, damage):
    with learned(tmp_path, 4) as baseline:
        change = baseline.accept("Ada")
        baseline.add(record(9, day=5))
    file = unit_folder(tmp_path, "elbow/1", "7") / "calibration.yaml"
    original = file.read_bytes()
    file.write_bytes(damage) if damage is not None else file.unlink()
    with UnitBaseline(tmp_path, JOINT) as again:
        assert not again.damage
        assert again.accepted_by == change
        assert len(again.candidates) == 1
    assert file.read_bytes() == original


def test_damaged_calibration_without_its_records_is_unknown_until_it_is_reset(tmp_path: Path):
    with learned(tmp_path, 4) as baseline:
        baseline.accept("Ada")
    folder = unit_folder(tmp_path, "elbow/1", "7")
    (folder / "calibration.yaml").write_bytes(b"format: joint_1\n")
    next((folder / "records").iterdir()).unlink()
    with UnitBaseline(tmp_path, JOINT) as again:
        assert not again.is_accepted
        assert not again.is_fit_due
        assert "is a damaged calibration" in again.progress().reason
        with pytest.raises(ValueError, match="restore the file from a copy, or reset"):
            again.add(record(9, day=5))
        with pytest.raises(ValueError, match="is a damaged calibration"):
            again.accept("Ada", force=True)
        again.reset("Ada", "the disk was full")
        assert not again.damage
        assert again.candidates == []
        assert again.add(record(9, day=5))
    with UnitBaseline(tmp_path, JOINT) as learning:
        assert not learning.damage
        assert len(learning.candidates) == 1


def test_damaged_line_of_the_acceptance_leaves_its_records_accepted(tmp_path: Path):
    with learned(tmp_path, 4) as baseline:
        change = baseline.accept("Ada")
        baseline.add(record(9, day=5))
    history = unit_folder(tmp_path, "elbow/1", "7") / "changes.jsonl"
    history.write_bytes(history.read_bytes()[:-30])
    with UnitBaseline(tmp_path, JOINT) as again:
        assert again.calibration is not None
        assert again.calibration.calibration_id == change.after
        assert again.accepted_by is None
        assert len(again.candidates) == 1
        assert again.extend("Ada").records == 5
