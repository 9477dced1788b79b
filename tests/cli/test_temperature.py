# SPDX-License-Identifier: Apache-2.0
"""A temperature column of a table, from ema check to the comparison with warmer records."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.monitor.joint.plant import Joint, Sensors, telemetry_of, tones

from ema_bags.inputs.doubts import DoubtKind
from ema_bags.inputs.files import open_input
from ema_core.description import ActuatorDescription

ACTUATOR = "actuator_id: wrist\nserial_number: W-1\ndrive: unknown\n"
KELVIN = {"healthy": [18.0, 27.0, 22.0, 30.0, 20.0, 25.0, 28.0, 19.0], "hot": 29.0, "worn": 21.0}


def write(path: Path, day: int, celsius: float, friction: float = 1.0) -> Path:
    """Write a record of a joint whose dry friction falls by 1 %/K and viscous friction by 3 %/K."""
    warm = celsius - 20.0
    thick = np.exp(-0.03 * warm)
    joint = Joint().times(coulomb=friction * (1.0 - 0.01 * warm), viscous=thick)
    telemetry = telemetry_of(joint, tones(30.0), Sensors(), seed=day, day=day)
    stamps = telemetry.stamps_ns
    pd.DataFrame(
        {
            "Time": pd.to_datetime(stamps),
            "Position [rad]": telemetry.position,
            "Current [A]": telemetry.current,
            "Motor temperature [K]": celsius + 273.15 + 0.004 * np.arange(len(stamps)) / 100.0,
        }
    ).to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("warm")
    (path / "actuator.yaml").write_text(ACTUATOR)
    for day, celsius in enumerate(KELVIN["healthy"]):
        write(path / f"healthy_{day}.csv", day // 2, celsius)
    write(path / "hot.csv", 30, KELVIN["hot"])
    write(path / "worn.csv", 31, KELVIN["worn"], friction=1.1)
    return path


def friction(ema, folder, name):
    result = ema("estimate", folder / f"{name}.csv", "--json")
    (estimate,) = json.loads(result.stdout)
    quantities = {item["name"]: item for item in estimate["comparison"]["quantities"]}
    return quantities["friction"], estimate


def calibrated(ema, folder, mapping):
    (folder / "mapping.yaml").write_text(mapping)
    healthy = sorted(folder.glob("healthy_*.csv"))
    made = ema("calibrate", *healthy, "-o", folder / "calibration.yaml", "--replace")
    assert made.exit_code == 0, made.output
    return made.stdout


def test_friction_is_compared_at_the_temperature_of_the_record(ema, folder):
    source = folder / "healthy_0.csv"
    checked = ema("check", source, "--actuator", folder / "actuator.yaml", "--json")
    [joint] = json.loads(checked.stdout)[0]["joints"]
    column = next(item for item in joint["columns"] if item["quantity"] == "temperature")
    assert (column["unit"], column["low"]) == ("K", pytest.approx(291.15, abs=0.01))
    mapping = joint["mapping"]
    assert "temperature:\n  source: Motor temperature [K]\n  unit: K\n" in mapping
    words = calibrated(ema, folder, mapping)
    assert "winding temperature -2 ± 2 K to winding temperature +10 ± 2 K in 8 windows" in words
    hot, estimate = friction(ema, folder, "hot")
    assert hot["judgement"] == "unchanged"
    assert abs(hot["change"]) < 0.02
    assert estimate["measured"][0]["name"] == "winding_temperature"
    worn, _ = friction(ema, folder, "worn")
    assert worn["judgement"] == "changed"
    assert worn["change"] == pytest.approx(0.1, abs=0.02)
    # Without the column, the same change is within the possible effect of temperature.
    start, end = mapping.index("temperature:\n"), mapping.index("clock:\n")
    calibrated(ema, folder, mapping[:start] + mapping[end:])
    blind, _ = friction(ema, folder, "worn")
    assert blind["judgement"] != "changed"
    assert blind["smallest_change"] > 3.0 * worn["smallest_change"]


def test_temperature_of_a_modelled_drive_is_doubted_and_not_mapped(folder):
    source = open_input(folder / "healthy_0.csv")
    guess = source.guess(ActuatorDescription(drive="unknown", actuator_id="w", serial_number="1"))
    assert guess.mapping.temperature is not None
    frame = pd.read_csv(folder / "healthy_0.csv")
    frame["Command [rad]"] = frame["Position [rad]"]
    frame.to_csv(folder / "commanded.csv", index=False)
    guess = open_input(folder / "commanded.csv").guess(ActuatorDescription())
    assert guess.mapping.temperature is None
    assert DoubtKind.WINDING in [doubt.kind for doubt in guess.doubts]
