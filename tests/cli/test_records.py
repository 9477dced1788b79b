# SPDX-License-Identifier: Apache-2.0
"""Recordings of an unknown drive: each file becomes a record, or is refused with a reason."""

from pathlib import Path

import numpy as np
import pytest

from ema_core.telemetry import Telemetry

DESCRIPTION = "actuator_id: flap\nserial_number: U-1\ndrive: unknown\n"
SLOW = DESCRIPTION + "sample_period: 0.04\nacquisition: {current: mean, speed: false}\n"
MAPPING = """position: {source: position_rad}
command: {source: command_rad}
current: {source: current_a, kind: equivalent, sampling: mean}
clock: {source: time_s}
"""


@pytest.fixture(scope="module")
def cycles(ema, tmp_path_factory) -> dict[int, Path]:
    """Return bags of one and of ten test cycles of half a second, one every 1.7 s, by number."""
    folder = tmp_path_factory.mktemp("cycles")
    (folder / "unit.yaml").write_text(DESCRIPTION)
    bags = {}
    for count in (1, 10):
        bags[count] = folder / f"{count}.mcap"
        words = ("--cycles", count, "--actuator", folder / "unit.yaml", "-o", bags[count])
        assert ema("simulate", *words).exit_code == 0
    return bags


@pytest.mark.parametrize("option", [(), ("--any-motion",)])
def test_ten_test_cycles_are_one_record_with_and_without_any_motion(ema, cycles, option):
    lines = ema("info", cycles[10], *option).stdout.splitlines()
    assert lines[-2:] == ["records: 1", "  0.0000 s to 16.9999 s: 17.0 s, usable"]


@pytest.mark.parametrize("option", [(), ("--any-motion",)])
def test_single_test_cycle_is_not_a_record_and_the_reason_is_stated(ema, cycles, option):
    reason = (
        "has no record to diagnose (no excitation): a record needs 2 s of motion, and the "
        "telemetry has only 1.7 s"
    )
    result = ema("info", cycles[1], *option)
    assert "records: 0" in result.stdout
    assert reason in result.stdout
    refused = ema("estimate", cycles[1], *option)
    assert refused.exit_code == 1
    assert reason in refused.stderr
    assert "--any-motion" not in refused.stderr


def trial(folder: Path, seconds: float, dwell_s: float) -> Path:
    """Write a CSV file at 25 Hz: strokes of 5 s and dwells, with steps and noise of an encoder."""
    h, stroke = 0.04, 0.6
    ramp = np.linspace(0.0, stroke, 125)
    dwell = np.full(round(dwell_s / h), stroke)
    cycle = np.concatenate([ramp, dwell, ramp[::-1], np.zeros(len(dwell))])
    command = np.resize(cycle, round(seconds / h))
    random = np.random.default_rng(1)
    position = np.round((command + 2e-4 * random.standard_normal(len(command))) / 1.5e-3) * 1.5e-3
    speed = np.gradient(command, h)
    current = 2.0 * np.sign(speed) * (np.abs(speed) > 0.01) + 0.5 * speed
    current += 0.05 * random.standard_normal(len(command))
    rows = np.stack([h * np.arange(1, len(command) + 1), command, position, current], axis=1)
    path = folder / "trial.csv"
    header = "time_s,command_rad,position_rad,current_a"
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.6f")
    (folder / "mapping.yaml").write_text(MAPPING)
    (folder / "actuator.yaml").write_text(SLOW)
    return path


@pytest.mark.parametrize(("seconds", "dwell_s"), [(25.0, 1.5), (64.8, 1.5), (64.8, 4.5)])
def test_table_of_strokes_and_dwells_is_one_record(ema, tmp_path, seconds, dwell_s):
    """After its first 60 s, a trial of 64.8 s continues for less than a quarter of record_s."""
    lines = ema("info", trial(tmp_path, seconds, dwell_s)).stdout.splitlines()
    assert "records: 1" in lines
    begin, end = lines[lines.index("records: 1") + 1].split(":")[0].split(" to ")
    assert float(begin.removesuffix("s")) == pytest.approx(0.0, abs=0.01)
    # A dwell at the end is cut off after 0.5 s.
    assert float(end.removesuffix("s")) >= seconds - dwell_s


def test_recording_without_motion_is_refused_with_the_reason(ema, record, tmp_path):
    zeros = np.zeros(5000)
    bag = record(
        [Telemetry(100_000 + n * 500_000_000, 1e-4, 1 + n * 5000, *[zeros] * 4) for n in range(8)]
    )
    (tmp_path / "unit.yaml").write_text(DESCRIPTION)
    result = ema("info", bag, "--actuator", tmp_path / "unit.yaml", "--accept-defects")
    assert "records: 0" in result.stdout
    assert "a record requires 2 s of motion, but the position never changes" in result.stdout
