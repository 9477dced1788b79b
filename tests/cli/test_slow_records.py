# SPDX-License-Identifier: Apache-2.0
"""Records of an unknown drive at any rate, with one sample per block, from table to estimate."""

import json
import re

import numpy as np
import pandas as pd
import pytest
import yaml

from ema_bags.inputs import importing
from ema_cli.bags import records

MAPPING = """\
position: {source: set_point_mm - error_mm, unit: mm, lead: 0.005}
command: {source: set_point_mm, unit: mm, lead: 0.005}
current: {source: current_a, kind: magnitude}
clock: {source: time_s}
"""


def written(path, rate_hz, duration_s, *, friction_a=0.6, load_a=0.0, current_noise=0.02, seed=0):
    """Write a table of a slide that moves back and forth; its current has no sign."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(duration_s * rate_hz)) / rate_hz
    # Two frequencies: with one, a stiffness would look like inertia.
    tones = [(60.0, 2.0 * np.pi / 6.0), (30.0, 2.0 * np.pi / 3.7)]
    set_point = 100.0 - sum(size * np.cos(omega * times) for size, omega in tones)
    speed = sum(size * omega * np.sin(omega * times) for size, omega in tones)
    acceleration = sum(size * omega**2 * np.cos(omega * times) for size, omega in tones)
    error = 0.005 * speed + 0.01 * rng.standard_normal(len(times))
    torque = friction_a * np.sign(speed) + load_a + 1e-3 * acceleration
    current = np.abs(torque) + current_noise * rng.standard_normal(len(times))
    columns = {"set_point_mm": set_point, "error_mm": error, "current_a": np.abs(current)}
    pd.DataFrame({"time_s": times, **columns}).to_csv(path, index=False)
    return path


@pytest.fixture
def described(tmp_path):
    """Return the options for a mapping and a description that it writes."""
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    (tmp_path / "slide.yaml").write_text(
        "actuator_id: slide\nserial_number: R1\nsample_period: 0.04\ndrive: unknown\n"
        "parameters: {tau: 1.0}\n"
    )
    return ("--mapping", tmp_path / "mapping.yaml", "--actuator", tmp_path / "slide.yaml")


@pytest.mark.parametrize("rate_hz", [10, 25, 50, 67, 100, 500, 1000])
def test_table_of_any_rate_leads_to_an_estimate(ema, tmp_path, monkeypatch, described, rate_hz):
    for module, name in ((records, "BLOCK_S"), (importing, "_BLOCK_SAMPLES")):
        monkeypatch.setattr(module, name, 1e-9)  # one sample per block
    duration_s = max(24.0, 1600.0 / rate_hz)
    for name, friction in (("healthy", 0.6), ("worn", 0.9)):
        table = written(tmp_path / f"{name}.csv", rate_hz, duration_s, friction_a=friction)
        result = ema("import", table, *described, "-o", tmp_path / f"{name}.mcap")
        assert result.exit_code == 0, result.output
    calibration = tmp_path / "calibration.yaml"
    result = ema("calibrate", tmp_path / "healthy.mcap", "-o", calibration)
    assert result.exit_code == 0, result.output
    result = ema("estimate", tmp_path / "worn.mcap", "--calibration", calibration, "--json")
    assert result.exit_code == 3, result.output
    estimate = json.loads(result.stdout)[-1]
    assert (estimate["verdict"], estimate["valid"]) == ("departed", True)
    # 50 % more friction is 0.25 of its range, which ends at three times the healthy friction.
    assert estimate["faults"]["friction"] == pytest.approx(0.25, abs=0.04)


@pytest.mark.parametrize(
    ("parameters", "shown"),
    [
        ("{tau: 1.0}", "nominal parameters: lead 0.005"),  # according to the mapping
        ("{lead: 0.005, k_t: 0.5}", "nominal parameters: k_t 0.5, lead 0.005"),
    ],
)
def test_info_shows_the_parameters_of_an_unknown_drive_that_are_used(
    ema, tmp_path, described, parameters, shown
):
    unit = tmp_path / "slide.yaml"
    unit.write_text(unit.read_text().replace("{tau: 1.0}", parameters))
    table = written(tmp_path / "short.csv", 25, 5.0)
    assert ema("import", table, *described, "-o", tmp_path / "short.mcap").exit_code == 0
    lines = ema("info", tmp_path / "short.mcap").stdout.splitlines()
    assert [line for line in lines if "parameters" in line] == [shown]
    assert "actuator slide, serial number R1" in lines


def test_too_short_record_states_its_length_and_the_required_one(ema, tmp_path, described):
    table = written(tmp_path / "short.csv", 25, 5.0)
    frame = pd.read_csv(table)
    frame.drop(index=range(90, 93)).to_csv(table, index=False)
    assert ema("import", table, *described, "-o", tmp_path / "short.mcap").exit_code == 0
    calibration = tmp_path / "calibration.yaml"
    result = ema("calibrate", tmp_path / "short.mcap", "-o", calibration)
    assert result.exit_code == 1
    assert "3 lost samples of 125 interpolated" in result.stderr
    assert re.search(
        r"no healthy record can be used: \d+ rows of steady motion in one direction, at least 30 "
        "are needed: record a longer motion",
        result.stderr,
    )
    assert not calibration.exists()


def test_joints_of_one_table_are_imported_at_once_and_separated(ema, tmp_path, described):
    sections = yaml.safe_load(MAPPING)
    for name, section in sections.items():
        if name != "clock":
            section["source"] = re.sub(r"(\w+)", r"\1_{joint}", section["source"])
    (tmp_path / "mapping.yaml").write_text(yaml.safe_dump({"joints": ["hip", "knee"], **sections}))
    for knee, name in ((0.6, "healthy"), (0.9, "worn")):
        tables = [
            pd.read_csv(written(tmp_path / "one.csv", 25, 64.0, friction_a=friction, seed=seed))
            for seed, friction in enumerate((0.6, knee))
        ]
        both = tables[0].merge(tables[1], on="time_s", suffixes=("_hip", "_knee"))
        both.to_csv(tmp_path / f"{name}.csv", index=False)
        output = ("-o", tmp_path / f"{name}.mcap")
        result = ema("import", tmp_path / f"{name}.csv", *described, *output)
        assert "1600 samples of knee (R1) at 25 Hz" in result.stdout
    checked = ema("check", tmp_path / "worn.csv", *described).stdout
    assert "joint hip" in checked
    assert "joints:\n- hip\n- knee\n" in checked
    for joint, expected in (("hip", 0.0), ("knee", 0.25)):
        options = ("--actuator-id", joint)
        calibration = tmp_path / f"{joint}.yaml"
        result = ema("calibrate", tmp_path / "healthy.mcap", *options, "-o", calibration)
        assert result.exit_code == 0, result.output
        options = (*options, "--calibration", calibration, "--json")
        result = ema("estimate", tmp_path / "worn.mcap", *options)
        estimate = json.loads(result.stdout)[-1]
        assert estimate["faults"]["friction"] == pytest.approx(expected, abs=0.04)
    result = ema("calibrate", tmp_path / "healthy.mcap", "-o", tmp_path / "c.yaml")
    assert "'hip', 'knee': choose one by actuator_id (--actuator-id)" in result.stderr


def cycles(ema, folder, described, seconds: float) -> None:
    """Import tables of eight healthy and eight worn cycles, each cycle as a separate piece."""
    mapping = folder / "mapping.yaml"
    mapping.write_text(
        MAPPING.replace("source: time_s", "rate_hz: 25") + "table: {segment: cycle}\n"
    )
    for name, friction in (("healthy", 0.6), ("worn", 0.9)):
        tables = [
            pd.read_csv(written(folder / "one.csv", 25, seconds, friction_a=friction, seed=seed))
            for seed in range(8)
        ]
        rows = pd.concat([table.assign(cycle=number) for number, table in enumerate(tables)])
        rows.to_csv(folder / f"{name}.csv", index=False)
        output = ("-o", folder / f"{name}.mcap")
        assert ema("import", folder / f"{name}.csv", *described, *output).exit_code == 0


def test_each_cycle_of_a_table_is_a_record(ema, tmp_path, described):
    cycles(ema, tmp_path, described, 20.0)
    calibration = tmp_path / "calibration.yaml"
    result = ema("calibrate", tmp_path / "healthy.mcap", "-o", calibration)
    assert result.exit_code == 0, result.output
    assert "from 8 records without a date" in result.stdout
    result = ema("estimate", tmp_path / "worn.mcap", "--calibration", calibration, "--json")
    assert result.exit_code == 3
    estimates = json.loads(result.stdout)
    assert [estimate["verdict"] for estimate in estimates] == ["departed"] * 8
    for estimate in estimates:
        assert estimate["faults"]["friction"] == pytest.approx(0.25, abs=0.04)


def test_cycles_with_too_few_strokes_are_refused_with_their_number(ema, tmp_path, described):
    cycles(ema, tmp_path, described, 8.0)
    calibration = tmp_path / "calibration.yaml"
    result = ema("calibrate", tmp_path / "healthy.mcap", "-o", calibration)
    assert result.exit_code == 1
    assert "2 strokes forward, at least 3 in each direction are needed" in result.stderr


def spoilt(frame, way, rng):
    """Return a table as an irregular logger writes it."""
    if way == "lost":
        return frame[rng.random(len(frame)) > 0.02]
    if way == "jitter":  # sampled at these times
        times = frame.time_s + 0.005 * rng.uniform(-0.9, 0.9, len(frame))
        columns = {name: np.interp(times, frame.time_s, frame[name]) for name in frame}
        return pd.DataFrame(columns | {"time_s": times})
    if way == "twice":
        return frame.loc[frame.index.repeat(1 + (rng.random(len(frame)) < 0.05))]
    begins = [8.1, 14.2, 21.0]
    return frame[~np.any([frame.time_s.between(at, at + 0.2) for at in begins], axis=0)]


@pytest.mark.parametrize("way", ["lost", "jitter", "twice", "bursts"])
def test_irregular_log_gives_the_estimate_of_the_intact_log(ema, tmp_path, described, way):
    rng = np.random.default_rng(3)
    written(tmp_path / "healthy.csv", 100, 30.0)
    frame = pd.read_csv(written(tmp_path / "intact.csv", 100, 30.0, friction_a=0.9, seed=1))
    spoilt(frame, way, rng).to_csv(tmp_path / "irregular.csv", index=False)
    estimates = {}
    for name in ("healthy", "intact", "irregular"):
        result = ema(
            "import", tmp_path / f"{name}.csv", *described, "-o", tmp_path / f"{name}.mcap"
        )
        assert result.exit_code == 0, result.output
    calibration = tmp_path / "calibration.yaml"
    assert ema("calibrate", tmp_path / "healthy.mcap", "-o", calibration).exit_code == 0
    for name in ("intact", "irregular"):
        result = ema("estimate", tmp_path / f"{name}.mcap", "--calibration", calibration, "--json")
        [estimates[name]] = json.loads(result.stdout)
        assert estimates[name]["verdict"] == "departed", result.output
    friction = [estimate["faults"]["friction"] for estimate in estimates.values()]
    assert 1.0 + 2.0 * friction[1] == pytest.approx(1.0 + 2.0 * friction[0], rel=0.01)
    counts = re.search(r"(\d+) lost samples of \d+ interpolated", estimates["irregular"]["reason"])
    assert bool(counts) == (way in ("lost", "bursts"))
