# SPDX-License-Identifier: Apache-2.0
"""Calibrations are stored exactly, and defective files are refused."""

import math
from dataclasses import MISSING, fields

import numpy as np
import pytest
import yaml

from ema_core.faults import healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.windows.band import band_limited, rms

from .windows import shortened

NAN = math.nan
ROWS = ("command", "correction", "speed_correction")
ARRAYS = (*ROWS, "unit_covariance")
EXACT = [field.name for field in fields(Calibration) if field.name not in ARRAYS]


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return shortened(Calibration.builtin())


@pytest.fixture(scope="module")
def path(calibration, tmp_path_factory):
    path = tmp_path_factory.mktemp("calibrations") / "unit.yaml"
    calibration.save(path)
    return path


@pytest.fixture(scope="module")
def content(path):
    return yaml.safe_load(path.read_text())


@pytest.fixture
def refused(tmp_path):
    """Return a function that returns the error message for a file with a content."""

    def refused(content) -> str:
        path = tmp_path / "other.yaml"
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            path.write_text(yaml.safe_dump(content))
        with pytest.raises(ValueError, match=r"other\.yaml is ") as error:
            Calibration.load(path)
        return str(error.value)

    return refused


def test_loaded_calibration_is_bit_identical_to_the_saved_one(calibration, path):
    loaded = Calibration.load(path)
    for name in ARRAYS:
        assert getattr(loaded, name).tobytes() == getattr(calibration, name).tobytes()
    for name in EXACT:
        assert getattr(loaded, name) == getattr(calibration, name)


def test_saving_replaces_an_older_file_and_leaves_no_other_file(calibration, tmp_path):
    path = tmp_path / "unit.yaml"
    path.write_text("older")
    calibration.save(path)
    assert [p.name for p in tmp_path.iterdir()] == ["unit.yaml"]
    assert Calibration.load(path).windows == calibration.windows


def test_builtin_calibration_is_that_of_the_built_in_actuator(stirred_window, description):
    builtin = Calibration.builtin()
    window = stirred_window({}, 3)
    assert builtin.unit_mismatch(description) == ()
    assert builtin.shape_mismatch(window) is None
    assert builtin.reference(window).knows_command
    expected = builtin.expect(
        builtin.model().respond(window, healthy_faults(), window.play), window
    )
    h, speed = window.sample_period, window.telemetry.speed[1:]
    # The residual of another healthy window is close to the stated residual.
    residual = band_limited(window.current - expected.current[0], h)
    assert rms(residual) == pytest.approx(builtin.healthy_rms, rel=0.25)
    residual = band_limited(speed - expected.speed[0], h)
    assert rms(residual) == pytest.approx(builtin.healthy_speed_rms, rel=0.35)


OTHER = "is not a calibration of format 4; make it again"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", OTHER),
        (b"- 1\n- 2\n", OTHER),
        (b"format: 2\n", OTHER),
        (b"lift: 1\n", OTHER),
        (b"a: [1, 2", "is not a YAML file: "),
    ],
)
def test_other_files_are_refused(refused, content, message):
    assert message in refused(content)


@pytest.mark.parametrize(
    "name", [field.name for field in fields(Calibration) if field.default is MISSING]
)
def test_missing_entry_is_refused_by_name(refused, content, name):
    del (damaged := dict(content))[name]
    message = refused(damaged)
    assert "is a damaged calibration: " in message
    assert name in message


def test_calibration_without_relations_of_the_columns_is_accepted(content, tmp_path):
    """Files of earlier versions have none; their identity, stored in recordings, is kept."""
    older = {**content}
    del older["travel_ratio"], older["law_offset"]
    (tmp_path / "older.yaml").write_text(yaml.safe_dump(older))
    loaded = Calibration.load(tmp_path / "older.yaml")
    assert np.isnan([loaded.travel_ratio, loaded.law_offset]).all()
    loaded.save(tmp_path / "again.yaml")
    assert set(yaml.safe_load((tmp_path / "again.yaml").read_text())) == set(older)
    assert Calibration.load(tmp_path / "again.yaml").calibration_id == loaded.calibration_id


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("colour", "red", "colour"),
        ("form", "exact", "'exact' is unknown"),
        ("dt", 0.0, "dt = 0"),
        ("command", [0.0, 1.0], "one more than"),
        ("correction", [], "one more than"),
        ("speed_correction", [], "of speed_correction"),
        ("parameters", {"R_s": -1.0}, "R_s = -1 ohm"),
        ("parameters", {"R_x": 1.0}, "'R_x'"),
        ("parameters", {"R_s": "low"}, "R_s = 'low'"),
        # A missing parameter must not silently get the value of the built-in actuator.
        ("parameters", {"k_e": 0.07}, "is missing"),
        *(
            (name, value, name)
            for name, values in {
                "command": ([[0.0]],),
                "correction": ([0.0, NAN], [0.0, math.inf]),
                "speed_correction": ([0.0, NAN],),
                "sample_period": ("short", 0.0, -1e-4),
                "dt": (None, 3e-5),
                "healthy_rms": ("small", -0.02),
                "healthy_speed_rms": (0.0, None),
                "model_rms": ("small", 0.0),
                "model_speed_rms": (-1.0, None),
                "unit_covariance": ([[0.0]], "small"),
                "unit": (None, 0.1),
                "windows": ("five", 0),
                "serial_number": (None, ""),
                "actuator_id": (3,),
            }.items()
            for value in values
        ),
    ],
)
def test_impossible_entry_is_refused_with_the_reason(refused, content, name, value, message):
    reason = refused({**content, name: value})
    assert "is a damaged calibration: " in reason
    assert message in reason


@pytest.mark.parametrize("value", ["high", None, NAN, math.inf])
@pytest.mark.parametrize("name", ["lift", "speed_delay"])
def test_impossible_deviation_is_refused_by_name(refused, content, name, value):
    unit = {**content["unit"], name: value}
    assert f"unit: {name} = {value!r}" in refused({**content, "unit": unit})


def test_manual_change_is_permitted_and_logged(content, calibration, tmp_path, caplog):
    path = tmp_path / "changed.yaml"
    path.write_text(yaml.safe_dump({**content, "windows": 7}))
    changed = Calibration.load(path)
    assert changed.windows == 7
    warning = f"was {calibration.calibration_id} and is {changed.calibration_id} now"
    assert warning in caplog.text
    caplog.clear()
    changed.save(path)
    Calibration.load(path)
    assert not caplog.text
