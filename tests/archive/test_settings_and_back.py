"""A run that dies with other settings, which are then taken back: no row of these stays."""

from dataclasses import replace

import pytest

from ema_archive import running
from ema_archive.bag_task import DAMAGED, DONE, BagResult, BagTask, UnitRows
from ema_archive.calibrations import calibration_of, identity_of
from ema_archive.manifest import Manifest
from ema_archive.partitions import read_unit
from ema_archive.running import RunTally, run, run_units, scan, write_results
from ema_archive.settings import ArchiveSettings
from ema_archive.sources import Listed
from ema_core.tasks import Workers

from .conftest import exactly

BEFORE = ArchiveSettings()
OTHER = replace(BEFORE, measured_max_age_s=2.0 * BEFORE.measured_max_age_s)
TASK = BagTask("/bags/1.mcap", "mark", "", BEFORE)


class DeathError(Exception):
    """The end of a process, at a moment that a test chooses."""


def die(*_):
    raise DeathError


def done_bag(friction):
    row = {"end_ns": 1, "valid": True, "friction": friction, "bag": TASK.url}
    calibration_id = identity_of(calibration_of("", "flap", "1"))
    return BagResult(TASK, DONE, units=[UnitRows("flap", "1", "model", calibration_id, [row], [])])


@pytest.mark.parametrize("found", [done_bag(0.9), BagResult(TASK, DAMAGED, "nothing in it")])
def test_bag_whose_rows_are_those_of_other_settings_is_done_again(tmp_path, monkeypatch, found):
    archive = tmp_path / "archive"
    with Manifest(archive, is_new=True) as manifest:
        manifest.note([Listed(TASK.url, 1, TASK.mark, "")], 1)
        manifest.end_scan(1, ["/bags"])
        write_results(manifest, [done_bag(0.1)], BEFORE)
        assert manifest.find_due(BEFORE) == 0
        with monkeypatch.context() as patch:
            patch.setattr(manifest, "commit", die)
            with pytest.raises(DeathError):
                write_results(manifest, [found], OTHER)
    with Manifest(archive) as manifest:
        assert manifest.find_due(BEFORE) == 1
        assert manifest.status(BEFORE).reasons == {"interrupted": 1}
        write_results(manifest, [done_bag(0.1)], BEFORE)
        assert manifest.find_due(BEFORE) == 0
    assert read_unit(archive, "estimates", "flap+1")["friction"].to_pylist() == [0.1]


@pytest.mark.slow
def test_unit_whose_health_is_that_of_other_settings_is_followed_again(
    made_fleet, tmp_path, monkeypatch
):
    archive = tmp_path / "archive"
    with Manifest(archive, is_new=True) as manifest, Workers("threads", 2) as pool:
        scan(manifest, [str(made_fleet / "unit_0")])
        run(manifest, pool)
        before = manifest.settings
        health = exactly(archive, "health")
        limits = replace(before.prognosis.limits, friction=0.2)
        manifest.settings = replace(before, prognosis=replace(before.prognosis, limits=limits))
        with monkeypatch.context() as patch:
            # The state that is kept is then that of the settings before.
            patch.setattr(running, "write_state", die)
            with pytest.raises(DeathError):
                run_units(manifest, pool, RunTally())
        assert exactly(archive, "health") != health
        manifest.settings = before
        assert len(manifest.units_due(before)) == 1
        run_units(manifest, pool, RunTally())
        assert exactly(archive, "health") == health
