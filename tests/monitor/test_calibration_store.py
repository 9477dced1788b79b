# SPDX-License-Identifier: Apache-2.0
"""Each unit has its own calibration, at the path of the setting."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from ema_core.description import ActuatorDescription
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration, CalibrationStore, load_calibration
from ema_monitor.joint.departure import HEALTHY
from ema_monitor.joint.window_baseline import ReferenceWindow, WindowBaseline
from ema_monitor.joint.window_figures import CommandedMotion, WindowFigures
from ema_monitor.reasons import CalibrationMissing, CalibrationUnusable, NoCalibration

from .windows import shortened

FLAP = ActuatorDescription()
RUDDER = replace(FLAP, actuator_id="rudder", serial_number="SIM-0002")
SHIPPED = Calibration.builtin()
SMALL = shortened(SHIPPED)


def of_unit(description: ActuatorDescription) -> Calibration:
    unit = {"actuator_id": description.actuator_id, "serial_number": description.serial_number}
    return replace(SMALL, **unit)


def identity(calibration: AnyCalibration | CalibrationMissing) -> str:
    assert isinstance(calibration, Calibration), calibration
    return calibration.calibration_id


def kept(
    store: CalibrationStore, unit: ActuatorDescription, calibration: Calibration, file: str
) -> Path:
    path = store.prepare(unit, file)
    store.keep(unit, calibration, path)
    return path


def test_shipped_calibration_is_used_without_a_file(tmp_path: Path):
    store = CalibrationStore("", tmp_path)
    assert identity(store.of(FLAP)) == SHIPPED.calibration_id
    assert identity(store.of(RUDDER)) == SHIPPED.calibration_id


def test_labels_are_kept_by_a_calibration_of_the_same_unit_and_motion(tmp_path: Path):
    currents = {"current_forward": 0.7, "current_backward": 0.5}
    part = WindowFigures(CommandedMotion(0.04, 3.0, 1.0), currents, 750)
    healthy = WindowBaseline((ReferenceWindow(HEALTHY, 0, part),))
    dry = WindowBaseline(
        (*healthy.windows, ReferenceWindow("dry", 1, part._replace(samples=700), 1))
    )
    store = CalibrationStore("", tmp_path)
    for unit, expected in ((FLAP, dry), (RUDDER, healthy)):
        path = kept(store, FLAP, replace(of_unit(FLAP), baseline=dry), "one.yaml")
        store.keep(unit, replace(of_unit(unit), baseline=healthy), path)
        assert load_calibration(path).baseline == expected


def test_baseline_in_a_file_of_an_earlier_version_is_read_with_its_identity(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    figures = WindowFigures(CommandedMotion(0.04, 3.0, 1.0), {"current_forward": 0.7}, 750)
    baseline = WindowBaseline(
        (ReferenceWindow(HEALTHY, 0, figures), ReferenceWindow("dry", 1, figures, 1))
    )
    made = replace(SMALL, baseline=baseline)
    path = tmp_path / "calibration.yaml"
    made.save(path)
    path.write_text(path.read_text().replace("\nbaseline:", "\nnormal:"))
    loaded = load_calibration(path)
    assert loaded.baseline == baseline
    assert loaded.calibration_id == made.calibration_id
    assert not caplog.records


def test_each_unit_has_its_own_file_which_outlives_the_monitor(tmp_path: Path):
    setting = f"{tmp_path}/{{actuator_id}}-{{serial_number}}.yaml"
    for unit in (FLAP, RUDDER):
        kept(CalibrationStore(setting, tmp_path), unit, of_unit(unit), "")
        kept(CalibrationStore("", tmp_path / "own"), unit, of_unit(unit), "")
    store, local = CalibrationStore(setting, tmp_path), CalibrationStore("", tmp_path / "own")
    for unit in (FLAP, RUDDER):
        assert identity(store.of(unit)) == of_unit(unit).calibration_id
        # Files in the folder of the monitor are read only on request.
        assert identity(local.of(unit)) == SHIPPED.calibration_id
        assert identity(local.load(unit, "")[0]) == of_unit(unit).calibration_id


def test_missing_or_damaged_file_is_reported_and_read_once_it_exists(tmp_path: Path):
    file = tmp_path / "calibration.yaml"
    store = CalibrationStore(str(file), tmp_path)
    assert str(file) in str(store.of(FLAP))
    assert isinstance(store.of(FLAP), NoCalibration)
    file.write_text("[")
    assert isinstance(store.of(FLAP), CalibrationUnusable)
    assert str(file) in str(store.of(FLAP))
    SMALL.save(file)
    assert identity(store.of(FLAP)) == SMALL.calibration_id


def test_new_calibration_is_stored_and_used_only_for_its_unit(tmp_path: Path):
    store = CalibrationStore("", tmp_path / "own")
    path = kept(store, RUDDER, of_unit(RUDDER), "")
    assert path.parent == tmp_path / "own"
    assert all(name in path.name for name in ("rudder", "SIM-0002"))
    assert Calibration.load(path).calibration_id == of_unit(RUDDER).calibration_id
    assert identity(store.of(RUDDER)) == of_unit(RUDDER).calibration_id
    assert identity(store.of(FLAP)) == SHIPPED.calibration_id
    # A replacing unit has a different serial number.
    replacement = replace(RUDDER, serial_number="SIM-0003")
    assert identity(store.of(replacement)) == SHIPPED.calibration_id


def test_path_comes_from_the_call_else_the_setting_else_the_folder(tmp_path: Path):
    setting, folder = f"{tmp_path}/set/{{actuator_id}}.yaml", tmp_path / "own"
    store = CalibrationStore(setting, folder)
    assert kept(store, FLAP, SMALL, "") == tmp_path / "set" / "flap.yaml"
    called = "called/{serial_number}.yaml"
    assert kept(store, FLAP, SMALL, called) == folder / "called" / "SIM-0001.yaml"
    assert CalibrationStore("", folder).load(FLAP, called)[1].name == "SIM-0001.yaml"
    assert CalibrationStore("", folder).load(FLAP, f"{folder}/{called}")[1].name == "SIM-0001.yaml"


@pytest.mark.parametrize(
    "file",
    [
        "../up.yaml",
        "/etc/calibration.yaml",
        "~/calibration.yaml",
        "~nouser/calibration.yaml",
        "link/calibration.yaml",
        ".bashrc",
        "nul\0.yaml",
        "long" * 2000 + ".yaml",
    ],
)
def test_call_accepts_only_files_of_the_folder(file: str, tmp_path: Path):
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "link").symlink_to(tmp_path)
    store = CalibrationStore("", folder)
    for act in (store.prepare, store.load):
        with pytest.raises((ValueError, OSError)):
            act(FLAP, file)
    assert [item.name for item in tmp_path.rglob("*")] == ["own", "link"]


@pytest.mark.parametrize("content", ["export PATH=", "windows: many", ""])
def test_file_that_is_not_a_calibration_is_not_overwritten(content: str, tmp_path: Path):
    file = tmp_path / "other.yaml"
    file.write_text(content)
    store = CalibrationStore("", tmp_path)
    with pytest.raises(ValueError, match=r"other\.yaml exists and is not a calibration"):
        store.prepare(FLAP, "other.yaml")
    SMALL.save(file)
    assert store.prepare(FLAP, "other.yaml") == file


def test_neither_pipe_nor_device_is_loaded(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "zero.yaml").symlink_to("/dev/zero")
    store = CalibrationStore("", tmp_path)
    with pytest.raises(ValueError, match="is not a regular file"):
        store.load(FLAP, "pipe.yaml")
    with pytest.raises(ValueError, match="inside"):
        store.load(FLAP, "zero.yaml")
    with pytest.raises(ValueError, match="is not a calibration"):
        store.prepare(FLAP, "pipe.yaml")


def test_names_cannot_lead_out_of_the_folder(tmp_path: Path):
    climber = replace(FLAP, actuator_id="../../up", serial_number="a/b")
    store = CalibrationStore("", tmp_path / "own")
    assert kept(store, climber, of_unit(climber), "").parent == tmp_path / "own"
    store = CalibrationStore(f"{tmp_path}/own/{{actuator_id}}.yaml", tmp_path)
    assert kept(store, climber, of_unit(climber), "").parent == tmp_path / "own"
    store = CalibrationStore(f"{tmp_path}/own/{{actuator_id}}/c.yaml", tmp_path)
    parent = replace(FLAP, actuator_id="..")
    assert (tmp_path / "own") in kept(store, parent, of_unit(parent), "").resolve().parents


def test_loaded_calibration_must_belong_to_the_unit(tmp_path: Path):
    file = tmp_path / "rudder.yaml"
    of_unit(RUDDER).save(file)
    store = CalibrationStore("", tmp_path)
    with pytest.raises(ValueError, match=r"rudder\.yaml: .*SIM-0002"):
        store.load(FLAP, str(file))
    assert identity(store.of(FLAP)) == SHIPPED.calibration_id
    calibration, path = store.load(RUDDER, str(file))
    assert path == file
    assert identity(store.of(RUDDER)) == calibration.calibration_id
    missing = r"/nowhere\.yaml does not exist: .*, or name a file in calibration_folder = "
    with pytest.raises(ValueError, match=missing):
        store.load(RUDDER, "nowhere.yaml")
    assert identity(store.of(RUDDER)) == calibration.calibration_id


@pytest.mark.parametrize(
    "file",
    [
        "{serial}.yaml",
        "{0}",
        "{",
        "{actuator_id!x}",
        "{actuator_id.name}",
        "{actuator_id:>3000000000}",
    ],
)
def test_other_names_in_braces_are_refused(file: str, tmp_path: Path):
    with pytest.raises(ValueError, match=r"calibration_file = .*actuator_id"):
        CalibrationStore(file, tmp_path)
    with pytest.raises(ValueError, match="actuator_id"):
        CalibrationStore("", tmp_path).load(FLAP, file)


def test_tilde_stands_for_the_home_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    SMALL.save(tmp_path / "c.yaml")
    assert identity(CalibrationStore("~/c.yaml", tmp_path).of(FLAP)) == SMALL.calibration_id
    with pytest.raises(ValueError, match=r"calibration_file = '~nouser/c\.yaml'"):
        CalibrationStore("~nouser/c.yaml", tmp_path)
