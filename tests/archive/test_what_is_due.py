# SPDX-License-Identifier: Apache-2.0
"""Only new or changed bags, and the results that depend on them, are processed again."""

import contextlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import fsspec
import pytest
from fsspec import AbstractFileSystem

from ema_archive import running
from ema_archive.bag_task import DONE, BagResult, diagnose_bag
from ema_archive.manifest import Manifest
from ema_archive.query import answer
from ema_archive.running import run, scan
from ema_bags.writer import BagWriter
from ema_core.description import ActuatorDescription
from ema_core.tasks import Workers
from ema_monitor.calibration.calibration import Calibration
from ema_ros import topics
from ema_ros.actuator_messages import messages_of_block
from ema_ros.messages import description_to_message
from ema_sim import simulate

from .conftest import exactly, table_of

HERE = ("--executor", "threads", "--workers", "2")


def bring_up_to_date(archive, *sources, workers=2):
    """Scan and run in this process; return the tally, and the status before the run."""
    with Manifest(archive, is_new=True) as manifest, Workers("threads", workers) as pool:
        scan(manifest, [str(source) for source in sources])
        due = manifest.status(manifest.settings)
        return run(manifest, pool), due


def of_unit_0(rows: list[str]) -> list[str]:
    return [row for row in rows if "-0000'" in row]


@pytest.mark.slow
def test_only_a_new_or_changed_bag_is_processed(archive, fleet):
    whole = exactly(archive, "estimates")
    bag = fleet / "unit_0" / "5.mcap"
    content = bag.read_bytes()
    # Truncated, as by a full disk: its window is incomplete.
    bag.write_bytes(content[: len(content) // 3])
    tally, due = bring_up_to_date(archive)
    assert (tally.bags, tally.units, due.reasons) == (1, 1, {"changed": 1})
    rows = table_of(archive, "estimates").to_pylist()
    assert not any(row["valid"] for row in rows if row["bag"] == str(bag))
    bag.unlink()
    tally, due = bring_up_to_date(archive)
    assert (tally.bags, due.gone) == (0, 1)
    bag.write_bytes(content)
    tally, due = bring_up_to_date(archive)
    assert (tally.bags, tally.units, due.gone) == (1, 1, 0)
    assert exactly(archive, "estimates") == whole


@pytest.mark.slow
def test_changed_calibration_makes_the_bags_of_its_unit_due(ema, archive, fleet):
    path = fleet / "unit_1" / "calibration.yaml"
    calibration = Calibration.load(path)
    replace(calibration, windows=calibration.windows + 1).save(path)
    status = json.loads(ema("archive", "status", archive, "--json").stdout)
    assert status["reasons"] == {"other calibration": 5}
    assert status["units_due"] == 1
    tally, _ = bring_up_to_date(archive)
    assert (tally.bags, tally.units) == (5, 1)
    assert ema("archive", "status", archive).stdout.endswith("everything is up to date\n")


@pytest.mark.slow
def test_run_reports_how_many_windows_are_refused_and_why(ema, archive, fleet, tmp_path):
    status = ema("archive", "status", archive)
    assert status.exit_code == 0
    assert "2 of 10 windows refused, most often because: gap" in status.output
    _, rows = answer(archive, "select what, codes, count from refused_why where codes <> []")
    assert rows == [("refused", ["samples_lost"], 2)]
    another = tmp_path / "another"
    calibration = fleet / "unit_1" / "calibration.yaml"
    ema("archive", "scan", another, fleet / "unit_0", "--calibration", calibration)
    result = ema("archive", "run", another, *HERE)
    assert result.exit_code == 3
    assert "5 of 5 windows refused, most often because: " in result.output
    assert "calibration" in result.output


@pytest.mark.slow
def test_bags_with_different_tests_at_the_same_time_are_refused_in_any_order(ema, tmp_path):
    bags, archive = tmp_path / "bags", tmp_path / "archive"
    bags.mkdir()
    ema("simulate", "--cycles", 2, "-o", bags / "new.mcap")
    ema("archive", "scan", archive, bags)
    assert ema("archive", "run", archive, *HERE).exit_code == 0
    ema("simulate", "--fault", "friction=0.6", "-o", bags / "worn.mcap")
    ema("archive", "scan", archive)
    result = ema("archive", "run", archive, *HERE)
    assert result.exit_code == 3
    # The second test of the healthy bag has another time, but may still be the older one.
    assert "3 of 3 windows refused, most often because: " in result.output
    assert "3 windows, 0 valid" in ema("archive", "status", archive).output
    assert len(answer(archive, "select bag from refused where what = 'refused'")[1]) == 3

    worn = ("--fault", "friction=0.6", "--start", "2026-03-01", "-o", bags / "worn.mcap")
    assert ema("simulate", *worn, "--replace").exit_code == 0
    ema("archive", "scan", archive)
    assert ema("archive", "run", archive, *HERE).exit_code == 0
    _, [(level, tested)] = answer(archive, "select health, tested from worst_first")
    assert (level, f"{tested:%Y-%m-%d}") == ("ERROR", "2026-03-01")
    assert ema("predict", bags, "--hours-per-cycle", 10).exit_code == 0


@pytest.mark.slow
def test_tests_added_one_by_one_give_the_same_health_as_all_at_once(archive, fleet, tmp_path):
    """Earlier tests are processed again only if a test arrives late."""
    bags, grown = tmp_path / "coming", tmp_path / "other"
    folder = bags / "unit_0"
    folder.mkdir(parents=True)
    (fleet / "unit_0" / "calibration.yaml").rename(folder / "calibration.yaml")
    followed = []
    # By time, except that the fourth test is added last.
    for name in ("9", "8", "7", "5", "6"):
        (fleet / "unit_0" / f"{name}.mcap").rename(folder / f"{name}.mcap")
        tally, _ = bring_up_to_date(grown, bags)
        assert (tally.bags, tally.units) == (1, 1)
        followed.append(tally.followed)
    assert followed == [1, 1, 1, 1, 5]
    assert exactly(grown, "health") == of_unit_0(exactly(archive, "health"))


@pytest.mark.slow
def test_limit_changes_health_and_no_estimate(ema, archive):
    estimates = exactly(archive, "estimates")
    result = ema("archive", "scan", archive, "--limit", "friction=0.2,free_play=1e-3")
    assert result.stdout.endswith("to process: 0 bags, 2 units\n")
    tally, _ = bring_up_to_date(archive)
    assert (tally.bags, tally.units) == (0, 2)
    assert exactly(archive, "estimates") == estimates
    # A scan with another option keeps the limits.
    ema("archive", "scan", archive, "--duty", "1.5")
    with Manifest(archive) as manifest:
        prognosis = manifest.settings.prognosis
    assert (prognosis.limits.friction, prognosis.service.duty) == (0.2, 1.5)


@pytest.mark.slow
def test_unusable_bags_are_rows_with_their_reason(ema, fleet, tmp_path):
    (fleet / "unit_0" / "empty.mcap").write_bytes(b"")
    (fleet / "unit_0" / "none.mcap").write_bytes(b"nothing of this is MCAP" * 100)
    folder = tmp_path / "archive"
    ema("archive", "scan", folder, fleet / "unit_0")
    result = ema("archive", "run", folder, *HERE)
    assert result.exit_code == 3
    assert "2 damaged, 0 read in part, 0 unreadable" in result.stdout
    question = "select bag, reason from refused where what = 'damaged' order by bag"
    _, rows = answer(folder, question)
    assert [Path(bag).name for bag, _ in rows] == ["empty.mcap", "none.mcap"]
    for bag, reason in rows:
        assert bag in reason
        printed = ema("estimate", bag)
        assert (printed.exit_code, reason in printed.stderr) == (1, True), printed.stderr
    # They are not read again until they change, but still count.
    result = ema("archive", "run", folder, *HERE)
    assert (result.exit_code, "0 bags and" in result.stdout) == (3, True)
    assert "2 bags cannot be read: later tests may be lost" in result.stdout


@pytest.mark.slow
def test_bag_of_two_actuators_has_rows_of_both(tmp_path):
    """An aircraft may have one recorder for several actuators."""
    path = tmp_path / "bags" / "two.mcap"
    path.parent.mkdir()
    units = [ActuatorDescription(actuator_id=name) for name in ("left", "right")]
    with contextlib.closing(BagWriter(path)) as writer:
        topic_classes = topics.ACTUATOR_TOPICS.items()
        for name, (message_class, qos) in topic_classes:
            writer.add_topic(f"{topics.NAMESPACE}/{name}", message_class, qos)
        telemetry = simulate()
        for unit in units:
            described = {topics.DESCRIPTION: description_to_message(unit, 0)}
            for name, message in (described | messages_of_block(unit, telemetry, 0.0)).items():
                writer.write(f"{topics.NAMESPACE}/{name}", message, telemetry.stamp_ns, 0)
    bring_up_to_date(tmp_path / "archive", path.parent)
    rows = table_of(tmp_path / "archive", "estimates").to_pylist()
    assert sorted(row["actuator_id"] for row in rows) == ["left", "right"]
    assert all(row["valid"] for row in rows)


@pytest.mark.slow
def test_bags_in_an_object_store_give_the_same_rows(archive, fleet, tmp_path):
    # Files of the store in memory are not thread-safe.
    store = fsspec.filesystem("memory")
    store.put(str(fleet / "unit_0"), "/fleet/unit_0", recursive=True)
    try:
        tally, _ = bring_up_to_date(tmp_path / "remote", "memory://fleet", workers=1)
    finally:
        store.rm("/fleet", recursive=True)
    assert (tally.bags, tally.damaged, tally.failed) == (5, 0, 0)
    assert exactly(tmp_path / "remote", "health") == of_unit_0(exactly(archive, "health"))
    [first, *_] = table_of(tmp_path / "remote", "estimates")["bag"].to_pylist()
    assert first.startswith("memory://")


class _Unreachable(AbstractFileSystem):
    """A file system that raises ``error`` at every access."""

    protocol = "unreachable"
    error: Exception

    def info(self, path, **kwargs):
        raise self.error

    def ls(self, path, detail=True, **kwargs):
        return self.info(path)


@pytest.mark.parametrize(
    # Packages for cloud stores raise errors of their own types.
    "error",
    [
        LookupError("no answer"),
        ConnectionRefusedError(111, "no answer"),
        OSError(113, "no answer"),
        OSError("no answer"),
    ],
    ids=repr,
)
def test_store_that_gives_no_answer_is_named(ema, tmp_path, monkeypatch, error):
    monkeypatch.setattr(_Unreachable, "error", error, raising=False)
    fsspec.register_implementation("unreachable", _Unreachable, clobber=True)
    result = ema("archive", "scan", tmp_path / "archive", "unreachable://fleet/bags")
    assert result.exit_code == 1
    assert "unreachable://fleet/bags: the store" in result.stderr
    assert "no answer" in result.stderr


@pytest.mark.slow
def test_bag_that_moved_counts_once(archive, fleet):
    def estimates():
        # As text, in which NaN equals NaN.
        rows = table_of(archive, "estimates").drop_columns("bag").to_pylist()
        return sorted(map(str, rows))

    before = estimates()
    (fleet / "unit_0" / "5.mcap").rename(fleet / "unit_0" / "moved.mcap")
    tally, due = bring_up_to_date(archive)
    assert (tally.bags, due.reasons, due.gone) == (1, {"new": 1}, 1)
    assert estimates() == before
    with Manifest(archive, writes=False) as manifest:
        status = manifest.status(manifest.settings)
    assert (status.bags, status.gone, status.due, status.units_due) == (10, 0, 0, 0)
    _, bags = answer(archive, "select bag from bags")
    assert (len(bags), sum(bag.endswith("moved.mcap") for (bag,) in bags)) == (10, 1)


@pytest.mark.slow
def test_copied_test_counts_once(archive, fleet, tmp_path):
    health = exactly(archive, "health")
    question = "select * exclude (end_hours, hours_left) from runs_to_failure"
    _, runs = answer(archive, question)
    names = ("0 before it.mcap", "copy.mcap")
    for name in names:
        shutil.copy(fleet / "unit_0" / "5.mcap", fleet / "unit_0" / name)
    tally, _ = bring_up_to_date(archive)
    assert (tally.bags, tally.followed) == (2, 0)
    assert exactly(archive, "health") == health
    assert sorted(map(str, answer(archive, question)[1])) == sorted(map(str, runs))
    _, [(bags,)] = answer(archive, "select bags from copies")
    assert [Path(bag).name for bag in bags] == [names[0], "5.mcap", names[1]]
    # A new archive of the same bags has the same health.
    bring_up_to_date(tmp_path / "anew", fleet / "unit_0")
    assert exactly(tmp_path / "anew", "health") == of_unit_0(health)


@pytest.mark.slow
def test_refused_copy_does_not_hide_a_valid_test(archive, fleet):
    health = exactly(archive, "health")
    first = fleet / "unit_0" / "0 before it.mcap"
    shutil.copy(fleet / "unit_0" / "5.mcap", first)

    def refused(task):
        result = diagnose_bag(task)
        for part in result.units:
            part.estimates[:] = [row | {"valid": False} for row in part.estimates]
        return result

    with Manifest(archive) as manifest, Workers("threads", 1) as pool:
        scan(manifest, [])
        running.run_bags(manifest, pool, running.RunTally(), diagnose=refused)
        running.run_units(manifest, pool, running.RunTally())
    assert len(answer(archive, "select bags from copies")[1]) == 1
    assert exactly(archive, "health") == health


def test_worker_with_other_software_is_refused(fleet, tmp_path):
    with Manifest(tmp_path / "archive", is_new=True) as manifest, Workers("threads", 1) as pool:
        scan(manifest, [str(fleet)])
        tally = run(manifest, pool, diagnose=diagnosed_elsewhere)
        status = manifest.status(manifest.settings)
    assert (tally.bags, tally.failed) == (10, 10)
    assert (status.windows, status.reasons) == (0, {"could not be read": 10})
    _, [(reason,)] = answer(tmp_path / "archive", "select distinct reason from bags")
    assert reason.startswith("the software of the worker differs from this command")


def diagnosed_elsewhere(task):
    return BagResult(task, DONE, sha256=task.url, software="of another version")


@pytest.mark.slow
def test_unit_processed_by_other_software_stays_due(archive, ema, monkeypatch):
    assert ema("archive", "scan", archive, "--limit", "friction=0.4").exit_code == 0
    before = exactly(archive, "health")
    followed = running.follow_unit
    monkeypatch.setattr(
        running, "follow_unit", lambda task: replace(followed(task), software="another")
    )
    tally, _ = bring_up_to_date(archive)
    assert (tally.units, len(tally.not_followed)) == (0, 2)
    assert exactly(archive, "health") == before
    monkeypatch.undo()
    tally, _ = bring_up_to_date(archive)
    assert (tally.units, tally.not_followed) == (2, {})
