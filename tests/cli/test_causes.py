# SPDX-License-Identifier: Apache-2.0
"""``ema simulate --cause``: hidden causes in the telemetry and the metadata of the bag."""

import numpy as np
import pytest
import yaml

from ema_cli.bags.reading import ReadingOptions, read_windows
from ema_core.causes import CAUSES
from ema_core.telemetry import COLUMNS, Telemetry, join
from ema_sim import api

CAUSE = ("load_torque=0.05", "current_offset=0.1@0.9", "winding_temperature=80@0..1")


def simulated(ema, bag, *arguments: str) -> Telemetry:
    result = ema("simulate", *arguments, "--replace", "-o", bag)
    assert result.exit_code == 0, result.stderr
    blocks: list[Telemetry] = []
    read_windows(bag, ReadingOptions(), blocks.append)
    return join(blocks)


def options(causes: tuple[str, ...]) -> list[str]:
    return [part for cause in causes for part in ("--cause", cause)]


@pytest.mark.parametrize("causes", [(), CAUSE])
def test_bag_has_the_same_telemetry_as_the_library(ema, tmp_path, causes):
    recorded = simulated(ema, tmp_path / "case.mcap", *options(causes))
    expected = api.simulate(causes=causes)
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(recorded, column), getattr(expected, column))


def test_true_causes_are_in_the_metadata(ema, tmp_path):
    simulated(ema, tmp_path / "case", *options(CAUSE))
    text = (tmp_path / "case" / "metadata.yaml").read_text()
    noted = yaml.safe_load(text)["rosbag2_bagfile_information"]["custom_data"]
    assert noted == {"hidden_causes": " ".join(CAUSE)}


def test_wrong_name_is_refused_with_the_names_of_all_causes(ema, tmp_path):
    printed = ema("simulate", "--cause", "nonsense=1", "-o", tmp_path / "case").stderr
    assert all(cause.name in printed for cause in CAUSES)
