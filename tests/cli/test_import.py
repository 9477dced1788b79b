# SPDX-License-Identifier: Apache-2.0
"""``ema import`` writes bags that all other commands read, and reports errors before it writes."""

import numpy as np
import pandas as pd
import pytest
import yaml

from ema_bags import read_telemetry
from ema_core.telemetry import COLUMNS, join
from ema_monitor.recordings import read_windows
from ema_sim import simulate

RPM = 60.0 / (2.0 * np.pi)


GERMAN = {
    "time": lambda x: x * 1e3,
    "position": lambda x: -np.degrees(x),
    "command": np.degrees,
    "speed": lambda x: x * RPM,
    "current": lambda x: 1e3 * x,
}
GERMAN_HEAD = "Zeit [ms];Soll [deg];Ist [deg];Drehzahl [1/min];Strom [mA]"


@pytest.fixture(scope="module")
def telemetry():
    return simulate({"friction": 0.25})


@pytest.fixture
def table(telemetry, tmp_path):
    """Return a function that writes the telemetry as CSV, with columns changed by functions."""

    def write(name="exact.csv", *, separator=",", decimal=".", **changes):
        columns = {
            "time": telemetry.stamps_ns * 1e-9,
            "command [rad]": telemetry.command,
            "position [rad]": telemetry.position,
            "speed [rad/s]": telemetry.speed,
            "current [A]": telemetry.current,
        }
        for name_of, change in changes.items():
            full = next(item for item in columns if item.startswith(name_of))
            columns[full] = change(columns[full])
        path = tmp_path / name
        pd.DataFrame(columns).to_csv(path, index=False, sep=separator, decimal=decimal)
        return path

    return write


def recognised(ema, path):
    """Return path and text of the mapping that ema check recognises for the built-in drive."""
    built_in = path.with_name("built_in.yaml")
    built_in.write_text("model: built-in\n")
    mapping = path.with_suffix(".yaml")
    result = ema("check", path, "--actuator", built_in, "-o", mapping, "--replace")
    assert result.exit_code in (0, 3), result.output
    return mapping, mapping.read_text()


@pytest.mark.parametrize("form", ["csv", "german", "parquet"])
def test_table_with_its_recognised_mapping_gives_the_same_telemetry(
    ema, telemetry, table, tmp_path, form
):
    path = table()
    if form == "german":
        path = table("de.csv", separator=";", decimal=",", **GERMAN)
        path.write_text("\n".join([GERMAN_HEAD, *path.read_text().splitlines()[1:]]) + "\n")
    elif form == "parquet":
        path = tmp_path / "case.parquet"
        pd.read_csv(table()).to_parquet(path)
    mapping, text = recognised(ema, path)
    assert yaml.safe_load(text)["position"].get("sign", 1) == (-1 if form == "german" else 1)
    output = tmp_path / "imported"
    result = ema("import", path, "--mapping", mapping, "-o", output)
    assert "17000 samples of flap (SIM-0001) at 10000 Hz, 1.700 s of telemetry" in result.stdout
    imported = join(list(read_telemetry(output)))
    assert imported.stamp_ns == telemetry.stamp_ns
    for column in COLUMNS:
        expected = getattr(telemetry, column)
        np.testing.assert_allclose(getattr(imported, column), expected, rtol=1e-12, atol=1e-12)


def test_defect_stops_the_import_with_value_and_remedy(ema, table, tmp_path):
    mapping, _ = recognised(ema, table())
    path = table("rpm.csv", speed=lambda x: x * RPM)
    output = tmp_path / "out.mcap"
    result = ema("import", path, "--mapping", mapping, "-o", output)
    assert result.exit_code == 1
    assert "speed has unit rad/s, but is probably rpm" in result.stderr
    assert "speed: {unit: rpm}" in result.stderr
    assert not output.exists()
    accepting = tmp_path / "accepting.yaml"
    accepting.write_text(mapping.read_text() + "accept: [speed_unit]\n")
    assert ema("import", path, "--mapping", accepting, "-o", output).exit_code == 0
    forced = ("--accept-defects", "--replace", "-o", output)
    assert ema("import", path, "--mapping", mapping, *forced).exit_code == 0


def test_files_are_joined_in_order_in_one_bag(ema, table, tmp_path):
    mapping, _ = recognised(ema, table())
    output = tmp_path / "two.mcap"
    files = (table("a.csv"), table("b.csv"))
    result = ema("import", *files, "--mapping", mapping, "-o", output)
    assert "34000 samples" in result.stdout
    assert (
        "without --actuator, the bag has the description of the built-in actuator" in result.stderr
    )
    assert "windows: 2" in ema("info", output).stdout
    blocks = list(read_telemetry(output))
    ends = [block.stamp_at(len(block) - 1) for block in blocks]
    assert all(block.stamp_ns > end for block, end in zip(blocks[1:], ends, strict=False))


def test_description_comes_from_the_file_with_measured_rate_and_acquisition(ema, table, tmp_path):
    mapping, _ = recognised(ema, table())
    content = yaml.safe_load(mapping.read_text())
    content["current"] |= {"sampling": "filtered", "filter_time": 0.001}
    content["table"] = {}
    mapping.write_text(yaml.safe_dump(content))
    actuator = tmp_path / "flap.yaml"
    actuator.write_text("serial_number: '4711'\nsample_period: 0.5\n")
    output = tmp_path / "out.mcap"
    result = ema("import", table(), "--mapping", mapping, "--actuator", actuator, "-o", output)
    assert (result.exit_code, result.stderr) == (0, ""), result.output
    description = read_windows(output).description
    assert (description.serial_number, description.sample_period) == ("4711", 1e-4)
    assert description.acquisition.current == "filtered"
    assert description.acquisition.current_filter == 0.001


def test_times_before_zero_are_shifted(ema, table, tmp_path):
    """A triggered recorder has negative times before its trigger at 0 s."""
    path = table(time=lambda x: x - 0.5)
    mapping, _ = recognised(ema, path)
    output = tmp_path / "out.mcap"
    assert ema("import", path, "--mapping", mapping, "-o", output).exit_code == 0
    assert next(iter(read_telemetry(output))).stamp_ns == 500_100_000


@pytest.mark.parametrize(("stretch", "is_refused"), [(1.025, False), (2.0, True)])
def test_file_of_a_similar_rate_is_resampled_to_the_rate_of_the_first(
    ema, table, tmp_path, stretch, is_refused
):
    """The second logger has a slow clock, so that motor position and speed seem to disagree."""
    mapping, _ = recognised(ema, table())
    files = table("a.csv"), table("b.csv", time=lambda x: x * stretch, speed=lambda x: x / stretch)
    output = tmp_path / "two.mcap"
    result = ema("import", *files, "--mapping", mapping, "--accept-defects", "-o", output)
    if is_refused:
        assert result.exit_code == 1
        assert "expected equal rates" in result.stderr
        return
    assert result.exit_code == 0, result.output
    assert "b.csv: resampled from 9756 Hz to 10000 Hz, the rate of" in result.stderr
    # The first file lasts 1.7 s; the second 1.7 s times the stretch.
    assert f"at 10000 Hz, {1.7 * (1.0 + stretch):.2f}" in result.stdout
