# SPDX-License-Identifier: Apache-2.0
"""Every wrong input gives one clear line that names it, its value and the expected input."""

import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from rclpy.qos import QoSProfile

from ema_bags.writer import BagWriter
from ema_interfaces.msg import TelemetryBlock
from ema_ros.messages import telemetry_to_message

from ..commands import SAMPLE

FILES = {
    "junk.yaml": "- 1\n",
    "broken.yaml": "{",
    "old.yaml": "/**/actuator: {ros__parameters: {plant: {J_m: 2.0e-5}}}\n",
    "unit.yaml": "serial_number: SN-1\nparameters: {J_m: -1.0}\n",
}
"""Input files in the working directory of the command, next to the sample BAG."""

DESIGN = "design --travel 0.01 -o new.yaml"
NEW = "simulate -o new.mcap"


@pytest.mark.parametrize(
    ("line", "code", "parts"),
    [
        ("estimat a.mcap", 2, ["did you mean 'estimate'?"]),
        (f"{NEW} --fault friction=1.5", 2, ["friction", "1.5", "[0, 1]"]),
        (f"{NEW} --fault excentricity=0.1", 2, ["did you mean 'eccentricity'?"]),
        (f"{NEW} --cause jam=1 --cause jam=1@2", 2, ["jam", "more than once"]),
        (f"{NEW} -p plant.resistence=2", 2, ["did you mean 'plant.resistance'?"]),
        (f"{NEW} -p plant.R_s=2", 2, ["plant.R_s is named plant.resistance"]),
        (f"{NEW} -p plant.resistance=-2", 2, ["plant.resistance = -2 ohm"]),
        (f"{NEW} --params old.yaml", 2, ["plant.J_m is named plant.motor_inertia"]),
        ("estimate BAG -p threshold=1e-6", 2, ["threshold is named threshold_urad"]),
        (f"{NEW} --command square", 2, ["'square'", "chirp"]),
        (f"{NEW} --friction .3", 2, ["'--friction': use --fault friction=VALUE"]),
        (f"{NEW} --current_noise 1", 2, ["did you mean --current-noise?"]),
        (f"{NEW} --actuator missing.yaml", 1, ["missing.yaml"]),
        (f"{NEW} --actuator unit.yaml", 1, ["unit.yaml", "J_m", "-1", "kg.m^2"]),
        (f"{NEW} --params broken.yaml", 1, ["broken.yaml: expected a parameter file"]),
        ("estimate nowhere.mcap", 1, ["nowhere.mcap"]),
        ("estimate nowhere.mcap --calibration junk.yaml", 1, ["junk.yaml"]),
        ("estimate a.mcap --algorithm least-square", 2, ["did you mean 'least_squares'?"]),
        ("estimate BAG -p window_s=0", 2, ["window_s = 0"]),
        ("estimate BAG --measured load_torque=0.1", 2, ["'load_torque=0.1'", "NAME=VALUE:SIGMA"]),
        ("compare BAG --algorithms pso,psi", 2, ["'psi'", "least_squares", "pso"]),
        ("compare BAG --budget 9", 2, ["--budget", "-p budget=VALUE"]),
        ("compare BAG --algorithms pso -p budget=60", 1, ["pso", "budget = 60", "at least"]),
        ("compare BAG --any-motion", 2, ["`ema estimate --any-motion --algorithm NAME`"]),
        ("certify --sample-rate 333", 2, ["333", "whole number of microseconds"]),
        ("design -o new.yaml", 2, ["--travel"]),
        ("design --travel 5 -o new.yaml", 2, ["travel = 5 rad", "1.2 rad"]),
        (f"{DESIGN} --sigma 0.1,3", 2, ["'3'", "name=value"]),
        (f"{DESIGN} --sigma gain=0", 1, ["gain = 0", "above 0"]),
        ("design --travel 0.01 -o new.csv", 2, ["expected a name that ends in .yaml"]),
        ("design --travel 0.01 -o junk.yaml", 1, ["already exists: use --replace to overwrite it"]),
        ("import BAG", 2, ["Missing option '-o'"]),
        ("import BAG -o out.mcap", 2, ["`ema check", "recognises the columns"]),
        ("check nowhere.csv", 1, ["nowhere.csv: no such file"]),
        ("check BAG --joint flop", 1, ["there is no joint 'flop': expected 'ema/flap'"]),
        ("check BAG --mapping-only --json", 2, ["expected either --mapping-only or --json"]),
        ("import BAG --mapping junk.yaml -o out.mcap", 1, ["expected a mapping with"]),
        ("lives -o lives --fault backlas", 2, ["did you mean 'backlash'?"]),
        ("predict a.mcap --duty 0", 2, ["duty", "0", "0.001"]),
        ("predict a.mcap --known-law friction=linear", 2, ["friction", "exponential", "RATE"]),
        ("plot BAG -o a.gif", 2, ["ends in .png or .svg or .pdf"]),
        ("plot BAG -o none/a.png", 1, ["folder none does not exist: create it first"]),
        ("report BAG --cost removl=1", 2, ["--cost", "did you mean 'removal'"]),
        ("plot BAG --history", 1, ["has no estimates: use `ema report`"]),
        ("verify BAG", 1, ["has no estimates", "`ema up`"]),
        ("thesis -o study --quick --runs 5", 2, ["--quick and --runs exclude each other"]),
        ("up actuators", 2, ["'actuators'"]),
        ("up --actuators left monitor", 2, ["--actuators left: expected the node `actuator`"]),
        ("watch --namespace 'left wing'", 2, ["--namespace 'left wing'"]),
        # The environment of the tests forbids other machines.
        *((f"{name} --network", 1, ["--network: ROS_"]) for name in ("demo", "record", "watch")),
        *((f"{name} --network", 1, ["--network: ROS_"]) for name in ("up", "play a.mcap")),
    ],
)
def test_wrong_input_gives_one_line_and_nothing_is_written(
    ema, tmp_path, monkeypatch, line, code, parts
):
    monkeypatch.chdir(tmp_path)
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    result = ema(*(SAMPLE if word == "BAG" else word for word in shlex.split(line)))
    assert result.exit_code == code, result.output
    error = result.stderr.strip().splitlines()[-1]
    for part in parts:
        assert part in error
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == FILES


@pytest.mark.parametrize("column", ["current", "position"])
def test_dead_sensor_is_not_mistaken_for_faults(ema, record, faulty_blocks, column):
    blocks = [replace(block, **{column: np.zeros(len(block))}) for block in faulty_blocks]
    result = ema("estimate", record(blocks), "--json")
    assert result.exit_code == 3
    [estimate] = json.loads(result.stdout)
    assert not estimate["valid"]
    assert estimate["verdict"] == "failed"
    assert f"dead {column} sensor: its value is 0 throughout" in estimate["reason"]


def test_coarsely_sampled_command_still_matches_the_calibrated_one(ema, tmp_path):
    bag = tmp_path / "coarse.mcap"
    ema("simulate", "--fault", "friction=0.3", "-p", "resolution.command=1e-6", "-o", bag)
    result = ema("estimate", bag, "--json")
    assert result.exit_code == 0
    [estimate] = json.loads(result.stdout)
    assert estimate["faults"]["friction"] == pytest.approx(0.3, abs=0.02)


def test_gap_at_rest_is_reported_and_does_no_harm(ema, record, faulty_blocks):
    result = ema("estimate", record(faulty_blocks[:3] + faulty_blocks[5:]), "--json")
    assert result.exit_code == 0
    assert "gap of 200 samples" in result.stderr
    [estimate] = json.loads(result.stdout)
    assert estimate["faults"]["friction"] == pytest.approx(0.3, abs=0.02)


def test_truncated_bag_is_read_up_to_the_damage(ema, record, faulty_blocks):
    bag = record(faulty_blocks)
    content = bag.read_bytes()
    bag.write_bytes(content[: len(content) // 2])
    result = ema("info", bag)
    assert (result.exit_code, "damaged at byte" in result.stdout) == (0, True)
    recovered = int(result.stdout.split(" samples every")[0].split()[-1])
    # A lost chunk is a quarter of a second of telemetry.
    assert 2_500 < recovered < 8_500
    # Without a description, or without telemetry.
    bag.write_bytes(content[:100])
    result = ema("estimate", bag)
    assert result.exit_code == 1
    for part in ("TelemetryBlock", "damaged at byte"):
        assert part in result.stderr


def test_command_that_never_moves(ema, record, faulty_blocks):
    result = ema("estimate", record(faulty_blocks[:9]))
    assert result.exit_code == 1
    assert "no excitation" in result.stderr
    assert "--any-motion: any motion" in result.stderr


def test_description_for_a_bag_without_one_comes_from_a_file(ema, tmp_path, faulty_blocks):
    path, unit = tmp_path / "bare.mcap", tmp_path / "unit.yaml"
    with BagWriter(path) as bag:
        bag.add_topic("/t", TelemetryBlock, QoSProfile(depth=1))
        for block in faulty_blocks:
            bag.write("/t", telemetry_to_message(block, "flap"), block.stamp_ns)
    refused = ema("estimate", path)
    assert refused.exit_code == 1
    assert "no description of actuator 'flap'" in refused.stderr
    assert "--actuator" in refused.stderr
    unit.write_text("actuator_id: flap\n")
    result = ema("estimate", path, "--actuator", unit, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)[0]["faults"]["friction"] == pytest.approx(0.3, abs=0.02)


def test_numbers_may_be_written_without_a_point(ema, tmp_path):
    # YAML 1.1 reads 2e-4 and 1e5 as text.
    description, bag = tmp_path / "unit.yaml", tmp_path / "case.mcap"
    description.write_text("sample_period: 2e-4\nparameters: {G_prop: 1e5}\n")
    assert ema("simulate", "--actuator", description, "-o", bag).exit_code == 0
    assert "8500 samples every 0.0002 s" in ema("info", bag).stdout
