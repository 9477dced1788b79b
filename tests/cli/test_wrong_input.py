"""Every wrong input ends in one clear line that names it, its value and what was expected."""

import json
from dataclasses import replace

import numpy as np
import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ema_bags.writer import BagWriter
from ema_interfaces.msg import TelemetryBlock
from ema_ros.messages import telemetry_to_message


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("--fault", "friction=1.5"), ("friction", "1.5", "[0, 1]")),
        (("--fault", "rust=0.1"), ("'rust'", "friction", "gain")),
        (("--fault", "friction"), ("'friction'", "name=value")),
        (("--fault", "gain=0.1", "--fault", "gain=0.2"), ("gain", "more than once")),
        (("--cause", "load_torqe=1"), ("'load_torqe'", "did you mean 'load_torque'")),
        (("--cause", "load_torque=99"), ("load_torque", "99", "[-10, 10] N.m")),
        (("--cause", "load_torque"), ("'load_torque'", "NAME=VALUE[@START[..END]]")),
        (("--cause", "dead_time=1e-6@3..2"), ("dead_time", "3 s", "2 s")),
        (("--cause", "jam=1", "--cause", "jam=1@2"), ("jam", "more than once")),
        (("--random-faults", "--fault", "gain=0.1"), ("--random-faults", "--fault", "exclude")),
        (("-p", "plant.R_s=-2"), ("plant.R_s", "-2", "ohm")),
        (("-p", "plant.Rs=2"), ("'plant.Rs'", "plant.R_s")),
        (("-p", "resolution.current"), ("NAME=VALUE",)),
        (("-p", "resolution.current=-1"), ("resolution.current", "-1", "A")),
        (("--current-noise", "-1"), ("current_noise", "-1", "A")),
        (("--command", "square"), ("'square'", "chirp")),
        (("--command", "missing.csv"), ("missing.csv",)),
        (("-p", "command.amplitude=99"), ("command.amplitude", "99", "rad")),
        (("--set", "R_s=2"), ("'--set'", "-p plant.NAME=VALUE")),
        (("--actuator", "missing.yaml"), ("missing.yaml",)),
    ],
)
def test_simulate_refuses_by_name_value_and_range(ema, tmp_path, arguments, parts):
    bag = tmp_path / "case.mcap"
    result = ema("simulate", *arguments, "-o", bag)
    assert result.exit_code in (1, 2)
    error = result.stderr.strip().splitlines()[-1]
    for part in parts:
        assert part in error
    assert not bag.exists()


@pytest.mark.parametrize(
    ("arguments", "code", "parts"),
    [
        (("--algorithms", "pso,psi"), 2, ("'psi'", "least_squares", "pso")),
        (("--algorithms", ""), 2, ("''", "least_squares")),
        (("--algorithms", "pso,pso"), 2, ("pso", "more than once")),
        (("--algorithm", "pso"), 2, ("--algorithm",)),
        (("--budget", "9"), 2, ("--budget", "-p budget=VALUE")),
        (("--window", "-1"), 2, ("--window", "-1")),
        (("--window", "1"), 1, ("--window 1", "1 window", "from 0")),
        (("--algorithms", "pso", "-p", "budget=60"), 1, ("pso", "budget = 60", "at least")),
        (("-o", "picture.txt"), 1, ("picture.txt", ".png")),
        (("-o", "nowhere/picture.png"), 1, ("picture.png", "no folder nowhere")),
    ],
)
def test_compare_refuses_before_it_draws(ema, record, faulty_blocks, arguments, code, parts):
    bag = record(faulty_blocks)
    result = ema("compare", bag, *arguments)
    assert result.exit_code == code
    error = result.stderr.strip().splitlines()[-1]
    for part in parts:
        assert part in error
    assert list(bag.parent.iterdir()) == [bag]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("-p", "wanted_sigma=0"), ("wanted_sigma", "0", "[0.0001, 0.25]")),
        (("-p", "fitness=least_squares"), ("fitness", "'least_squares'", "'band_limited'")),
    ],
)
def test_estimate_of_any_motion_refuses_by_name_value_and_range(
    ema, record, faulty_blocks, arguments, parts
):
    result = ema("estimate", record(faulty_blocks), "--any-motion", *arguments)
    assert result.exit_code == 1
    for part in parts:
        assert part in result.stderr.strip().splitlines()[-1]


def test_existing_bag_is_kept_unless_it_may_be_replaced(ema, tmp_path):
    bag = tmp_path / "case.mcap"
    bag.write_bytes(b"precious")
    result = ema("simulate", "-o", bag)
    assert result.exit_code == 1
    assert "--replace" in result.stderr
    assert bag.read_bytes() == b"precious"


@pytest.mark.parametrize("column", ["current", "speed", "position"])
def test_dead_sensor_is_not_taken_for_faults(ema, record, faulty_blocks, column):
    blocks = [replace(block, **{column: np.zeros(len(block))}) for block in faulty_blocks]
    result = ema("estimate", record(blocks), "--json")
    assert result.exit_code == 3
    [estimate] = json.loads(result.stdout)
    assert not estimate["valid"]
    assert estimate["verdict"] == "failed"
    assert f"dead {column} sensor: it says 0 throughout" in estimate["reason"]


def test_coarse_command_is_still_the_calibrated_one(ema, tmp_path):
    bag = tmp_path / "coarse.mcap"
    ema("simulate", "--fault", "friction=0.3", "-p", "resolution.command=1e-6", "-o", bag)
    result = ema("estimate", bag, "--json")
    assert result.exit_code == 0
    [estimate] = json.loads(result.stdout)
    assert estimate["faults"]["friction"] == pytest.approx(0.3, abs=0.02)


def test_gap_at_rest_is_told_and_does_no_harm(ema, record, faulty_blocks):
    result = ema("estimate", record(faulty_blocks[:3] + faulty_blocks[5:]), "--json")
    assert result.exit_code == 0
    assert "gap of 200 samples" in result.stderr
    [estimate] = json.loads(result.stdout)
    assert estimate["faults"]["friction"] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_truncated_bag_is_read_as_far_as_it_goes(ema, record, faulty_blocks, tmp_path, share):
    whole = record(faulty_blocks)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: int(share * whole.stat().st_size)])
    result = ema("info", cut)
    assert result.exit_code == 0
    assert "breaks off" in result.stdout
    recovered = int(result.stdout.split(" samples every")[0].split()[-1])
    # A chunk, lost whole, is a quarter of a second of telemetry.
    assert share * 17_000 - 6_000 < recovered < 17_000


def test_bag_cut_before_its_telemetry_is_called_damaged(ema, record, faulty_blocks, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(record(faulty_blocks).read_bytes()[:100])
    result = ema("estimate", cut)
    assert result.exit_code == 1
    assert "TelemetryBlock" in result.stderr
    assert "breaks off" in result.stderr


def test_command_that_never_moves(ema, record, faulty_blocks):
    result = ema("estimate", record(faulty_blocks[:9]))
    assert result.exit_code == 1
    assert "no excitation" in result.stderr


def test_bag_without_description_takes_one_from_a_file(ema, tmp_path, faulty_blocks):
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


def test_bag_without_telemetry_names_its_topics(ema, tmp_path):
    path = tmp_path / "other.mcap"
    with BagWriter(path) as bag:
        bag.add_topic("/chatter", String, QoSProfile(depth=1))
        bag.write("/chatter", String(data="hello"), 1)
    result = ema("estimate", path)
    assert result.exit_code == 1
    assert "TelemetryBlock" in result.stderr
    assert "/chatter" in result.stderr


@pytest.mark.parametrize("content", [b"", b"not a bag at all"])
def test_file_that_is_no_bag(ema, tmp_path, content):
    path = tmp_path / "junk.mcap"
    path.write_bytes(content)
    result = ema("estimate", path)
    assert result.exit_code == 1
    assert "junk.mcap" in result.stderr


def test_missing_bag_and_wrong_calibration_file(ema, tmp_path):
    assert "nowhere.mcap" in ema("estimate", tmp_path / "nowhere.mcap").stderr
    junk = tmp_path / "junk.yaml"
    junk.write_text("- 1\n")
    result = ema("estimate", tmp_path / "nowhere.mcap", "--calibration", junk)
    assert result.exit_code == 1
    assert "junk.yaml" in result.stderr


def test_actuator_file_is_checked(ema, tmp_path):
    description = tmp_path / "unit.yaml"
    description.write_text("serial_number: SN-1\nparameters: {J_m: -1.0}\n")
    result = ema("simulate", "--actuator", description, "-o", tmp_path / "case.mcap")
    assert result.exit_code == 1
    for part in ("unit.yaml", "J_m", "-1", "kg.m^2"):
        assert part in result.stderr


def test_numbers_may_be_written_without_a_point(ema, tmp_path):
    # YAML 1.1 takes 2e-4 and 1e5 for text.
    description, bag = tmp_path / "unit.yaml", tmp_path / "case.mcap"
    description.write_text("sample_period: 2e-4\nparameters: {G_prop: 1e5}\n")
    assert ema("simulate", "--actuator", description, "-o", bag).exit_code == 0
    assert "8500 samples every 0.0002 s" in ema("info", bag).stdout
