# SPDX-License-Identifier: Apache-2.0
"""A calibration of records is stored exactly, and refuses wrong files and units."""

import logging
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from ema_monitor.calibration.joint_calibration import JointCalibration, calibrate_joint
from ema_monitor.joint.record import JointRecord
from ema_monitor.quantities import FRICTION
from ema_monitor.reason_texts import differences_text, text_of

from .plant import Joint, Sensors, described, healthy_telemetry, telemetry_of, tones, window_of

Content = dict[str, Any]


@pytest.fixture(scope="module")
def calibration() -> JointCalibration:
    records = healthy_telemetry(Joint(gravity=0.4), a_day=2)
    return calibrate_joint([window_of(record, temperature=20.0) for record in records], described())


@pytest.fixture
def path(calibration: JointCalibration, tmp_path: Path) -> Path:
    calibration.save(tmp_path / "joint.yaml")
    return tmp_path / "joint.yaml"


def load(path: Path) -> JointCalibration:
    return JointCalibration.of_content(path, yaml.safe_load(path.read_text(encoding="utf-8")))


def labelled(calibration: JointCalibration, state: str = "dry") -> JointCalibration:
    """Return the calibration with a later healthy record as an example of a state."""
    like = calibration.baseline.records[0]
    record = replace(like, stamp_ns=like.stamp_ns + 10**15)
    return replace(calibration, baseline=calibration.baseline.with_record(state, record))


def check_same(a: JointRecord, b: JointRecord) -> None:
    for item in fields(JointRecord):
        np.testing.assert_equal(getattr(a, item.name), getattr(b, item.name), item.name)


def test_file_stores_the_calibration_exactly(calibration, path):
    loaded = load(path)
    assert loaded.calibration_id == calibration.calibration_id
    assert loaded.baseline.preparation == calibration.baseline.preparation
    assert loaded.baseline.shape == calibration.baseline.shape
    for pair in zip(loaded.baseline.records, calibration.baseline.records, strict=True):
        check_same(*pair)
    assert loaded.comparer.smallest_changes == calibration.comparer.smallest_changes
    assert (loaded.parameters, loaded.sample_period) == (
        calibration.parameters, calibration.sample_period,
    )  # fmt: skip


def test_same_records_give_the_same_identity_and_others_a_different_one(calibration):
    again = calibrate_joint(
        [
            window_of(record, temperature=20.0)
            for record in healthy_telemetry(Joint(gravity=0.4), a_day=2)
        ],
        described(),
    )
    assert again.calibration_id == calibration.calibration_id
    assert again.calibration_id.startswith("J1-")
    smaller = replace(
        calibration,
        baseline=replace(calibration.baseline, records=calibration.baseline.records[1:]),
    )
    assert smaller.calibration_id != calibration.calibration_id


def test_label_changes_the_file_but_not_the_identity(calibration, path):
    with_label = labelled(calibration)
    assert with_label.calibration_id == calibration.calibration_id
    with_label.save(path)
    loaded = load(path)
    assert loaded.calibration_id == calibration.calibration_id
    assert loaded.baseline.states() == {"healthy": 6, "dry": 1}
    check_same(loaded.baseline.labelled[0].record, with_label.baseline.labelled[0].record)
    assert loaded.comparer.smallest_changes == calibration.comparer.smallest_changes


def test_labels_are_copied_to_a_replacing_calibration(calibration):
    moved = calibration.with_labels_of(labelled(calibration))
    assert moved.baseline.states() == {"healthy": 6, "dry": 1}
    # A record that is healthy in the new calibration loses its label.
    record = labelled(calibration).baseline.labelled[0].record
    healthier = replace(
        calibration,
        baseline=replace(calibration.baseline, records=(*calibration.baseline.records, record)),
    )
    assert healthier.with_labels_of(labelled(calibration)).baseline.labelled == ()


def test_manual_change_is_permitted_and_logged(path, caplog):
    content = yaml.safe_load(path.read_text())
    content["records"][0]["values"][0] *= 1.01
    with caplog.at_level(logging.WARNING):
        loaded = JointCalibration.of_content(path, content)
    assert loaded.calibration_id != content["calibration_id"]
    assert "was changed after it was written" in caplog.text


def _without(*keys: Any) -> Callable[[Content], None]:
    def change(content: Content) -> None:
        at: Any = content
        for key in keys[:-1]:
            at = at[key]
        del at[keys[-1]]

    return change


def _with(value: Any, *keys: Any) -> Callable[[Content], None]:
    def change(content: Content) -> None:
        at: Any = content
        for key in keys[:-1]:
            at = at[key]
        at[keys[-1]] = value

    return change


DAMAGES = {
    "no records": (_with([], "records"), "records is empty"),
    "records missing": (_without("records"), "'records'"),
    "values of letters": (
        _with(["a"] * 5, "records", 0, "values"),
        "values is not an array of numbers",
    ),
    "four values": (_with([1.0] * 4, "records", 0, "values"), "no 5 coefficients"),
    "short covariance": (_with([1.0] * 3, "records", 0, "covariance"), "damaged calibration"),
    "infinite covariance": (
        _with([math.inf] * 15, "records", 0, "covariance"),
        "finite covariance",
    ),
    "figures of letters": (_with({"effort_scatter": "x"}, "records", 0, "figures"), "damaged"),
    "figures missing": (_without("records", 0, "figures"), "'figures'"),
    "stamp missing": (_without("records", 0, "stamp_ns"), "stamp_ns"),
    "unknown field of a record": (_with(1.0, "records", 0, "colour"), "colour"),
    "no preparation": (_without("preparation"), "'preparation'"),
    "unknown field of the preparation": (_with(1.0, "preparation", "colour"), "colour"),
    "no shape": (_without("shape"), "'shape'"),
    "unknown term": (_with(1.0, "shape", "colour"), "colour"),
    "no parameters": (_without("parameters"), "'parameters'"),
    "impossible parameter": (_with(-1.0, "parameters", "k_t"), "k_t"),
    "unknown parameter": (_with(1.0, "parameters", "colour"), "colour"),
    "no serial number": (_without("serial_number"), "serial_number"),
    "records of text": (_with("records", "records"), "damaged"),
    "outlier without a finding": (_with([{"stamp_ns": 1}], "outliers"), "'finding'"),
    "label without a state": (_with([{"record": {}}], "labelled"), "'state'"),
}


@pytest.mark.parametrize(("damage", "words"), DAMAGES.values(), ids=DAMAGES)
def test_damaged_file_is_refused_with_its_name_and_defect(path, damage, words):
    content = yaml.safe_load(path.read_text())
    damage(content)
    with pytest.raises(ValueError, match=r"joint\.yaml is a damaged calibration") as raised:
        JointCalibration.of_content(path, content)
    assert words in str(raised.value)


@pytest.mark.parametrize("content", [None, [], "text", {"format": "joint_0"}, {"format": 7}])
def test_file_of_another_format_is_refused(path, content):
    with pytest.raises(ValueError, match="is not a calibration of format joint_1"):
        JointCalibration.of_content(path, content)


@pytest.mark.parametrize("seed", range(20))
def test_any_entry_replaced_by_rubbish_is_refused_or_loaded(path, seed):
    """Reading a file with any changed entry raises only ValueError."""
    rng = np.random.default_rng(seed)
    content = yaml.safe_load(path.read_text())
    at: Any = content
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        key = keys[rng.integers(len(keys))]
        if not isinstance(at[key], dict | list) or not at[key] or rng.random() < 0.2:
            break
        at = at[key]
    at[key] = [None, "rubbish", -1, math.nan, [], {}, True, 10**400][rng.integers(8)]
    with suppress(ValueError):
        assert JointCalibration.of_content(path, content).calibration_id


# Records unlike the others


def test_record_unlike_the_others_is_named_in_the_calibration_and_kept(tmp_path):
    records = healthy_telemetry(days=2, a_day=3)
    worn = telemetry_of(Joint().times(coulomb=1.31), tones(), Sensors(), seed=5, day=1, second=50)
    made = calibrate_joint(list(map(window_of, [*records, worn])), described())
    (outlier,) = made.outliers
    assert outlier.stamp_ns == worn.stamp_ns
    assert "Coulomb friction rose 3" in outlier.finding
    assert "the record of 2022-01-09 00:00:50 UTC differs from the other healthy records: " in str(
        outlier
    )
    assert str(outlier).endswith("Leave it out, or confirm that the unit was healthy")
    assert "from 7 records on 2 days, 1 outlier" in str(made)
    made.save(tmp_path / "joint.yaml")
    loaded = load(tmp_path / "joint.yaml")
    assert (loaded.outliers, loaded.windows) == (made.outliers, 7)
    assert loaded.calibration_id == made.calibration_id


def test_record_without_a_date_is_named_by_its_position():
    records = healthy_telemetry(days=2, a_day=3)
    worn = telemetry_of(Joint().times(coulomb=1.6), tones(), Sensors(), seed=5)
    undated = [replace(record, stamp_ns=0) for record in (*records[:2], worn, *records[2:])]
    made = calibrate_joint(list(map(window_of, undated)), described())
    (outlier,) = made.outliers
    assert outlier.number == 2
    assert str(outlier).startswith("healthy record 3 differs from the other healthy records: ")
    assert "from 7 records without a date, 1 outlier" in str(made)


def test_healthy_record_of_another_rate_has_no_rate_dependent_figures():
    records = healthy_telemetry(days=2, a_day=2)
    records[1] = replace(records[1], sample_period=1.05 * records[1].sample_period)
    made = calibrate_joint(list(map(window_of, records)), described())
    has_figures = [bool(record.figures and record.parts) for record in made.baseline.records]
    assert has_figures == [True, False, True, True]


def test_records_like_each_other_are_not_mentioned(calibration, path):
    assert calibration.outliers == ()
    assert "outliers" not in path.read_text()


# Match with a unit


def test_described_unit_fits(calibration):
    assert calibration.unit_mismatch(described()) == ()


def test_other_units_are_refused_with_the_differences(calibration):
    plain = described()
    description = replace(
        plain, drive="six_step", parameters=plain.parameters.replace({"tau": 0.01, "k_t": 0.05})
    )
    assert "drive = six_step" in differences_text(calibration.unit_mismatch(description))
    assert "serial number 'J2'" in differences_text(
        calibration.unit_mismatch(replace(plain, serial_number="J2"))
    )
    speed = described(Sensors(speed=True))
    assert "either in the telemetry or in the calibration" in differences_text(
        calibration.unit_mismatch(speed)
    )
    for name, value in (("tau", 0.5), ("k_t", 0.3), ("lead", 0.01)):
        changed = replace(plain, parameters=plain.parameters.replace({name: value}))
        assert f"{name} = {value:g}" in differences_text(calibration.unit_mismatch(changed))
    # Unused parameters may differ.
    changed = replace(plain, parameters=plain.parameters.replace({"R_s": 1.5}))
    assert calibration.unit_mismatch(changed) == ()


def test_other_rates_are_compared_up_to_the_band_of_the_filter(calibration):
    for h, fits in ((0.001, True), (0.05, True), (0.2, False)):
        window = window_of(telemetry_of(Joint(), tones(20.0, h=h), Sensors()))
        mismatch = calibration.shape_mismatch(window)
        assert (mismatch is None) == fits
        words = "record at a higher rate, or calibrate at this one"
        assert mismatch is None or words in text_of(mismatch)


def test_temperature_of_each_record_is_stored(calibration):
    assert {record.temperature for record in calibration.baseline.records} == {20.0}
    windows = [window_of(telemetry) for telemetry in healthy_telemetry(days=1)]
    plain = calibrate_joint(windows, described())
    assert all(math.isnan(record.temperature) for record in plain.baseline.records)


def test_description_without_a_current_is_refused():
    description = described()
    blind = replace(description, acquisition=replace(description.acquisition, current="none"))
    with pytest.raises(ValueError, match="needs a measured current or torque"):
        calibrate_joint([window_of(telemetry) for telemetry in healthy_telemetry(days=1)], blind)


def test_summary_states_friction_inertia_and_their_sources(calibration):
    text = str(calibration)
    assert "of joint (controller not modelled) from 6 records on 3 days" in text
    assert "friction 1" in text
    assert "± " in calibration.residual_text
    assert calibration.windows == 6
    assert calibration.comparer.smallest_changes[FRICTION] < 0.11
