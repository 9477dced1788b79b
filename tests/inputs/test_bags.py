# SPDX-License-Identifier: Apache-2.0
"""Bags from other publishers, in both storages of rosbag2, give the published telemetry."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard

from ema_bags.inputs.bags import SqliteBag
from ema_bags.inputs.examine import UNKNOWN_JOINT
from ema_bags.inputs.files import open_input
from ema_bags.inputs.importing import import_series
from ema_bags.reader import Bag
from ema_monitor.model.threads import limit_threads

from ..commands import ema
from . import other_makes
from .conftest import described, mapping_from
from .other_makes import START_NS, OtherBag
from .remarks import remarks_of

FLAP = described(1000)


def source(topic, path, **more):
    return {"topic": topic, "source": path, **more}


def joint_states(**changes):
    states = "/joint_states"
    content = {
        "joint": "flap",
        "position": source(states, "position"),
        "speed": source(states, "velocity", shaft="user"),
        "current": source(states, "effort"),
        "command": source("/commands", "data[1]", between="hold"),
    }
    return mapping_from(content | changes)


def imported(path, mapping, description=FLAP):
    return import_series(open_input(path).series(mapping), mapping, description)


def assert_same(recording, telemetry, start=0, tolerance=1e-12):
    """Compare the only run with the published telemetry, beginning at sample ``start``."""
    [run] = recording.runs
    assert len(run.values) == len(telemetry) - start
    expected = np.column_stack(
        [getattr(telemetry, name)[start:] for name in recording.stream.filled]
    )
    assert run.values == pytest.approx(expected, rel=tolerance, abs=tolerance)
    assert np.array_equal(run.stamps_ns, np.array(other_makes.stamps_of(telemetry))[start:])


@pytest.mark.parametrize(
    ("storage", "compression"),
    [("sqlite3", ""), ("mcap", ""), ("sqlite3", "MESSAGE"), ("mcap", "FILE")],
)
def test_joint_states_in_both_storages_give_the_published_telemetry(
    telemetry, tmp_path, storage, compression
):
    path = tmp_path / "bag"
    with OtherBag(path, storage, compression) as bag:
        other_makes.write_joint_states(bag, telemetry)
    assert_same(imported(path, joint_states()), telemetry)


def test_each_malformed_message_is_counted_once(telemetry, tmp_path):
    """The count does not depend on repeated reads, additional topics or equal reception times."""
    with OtherBag(tmp_path / "bag") as bag:
        other_makes.write_joint_states(bag, telemetry)
        bag.write("/first", bag.make("std_msgs/msg/Float64", 0.0), 0)
        for received_ns in (1, 2, 2, 2):
            bag.write_raw("/joint_states", b"\x00\x01\x00\x00\x07", received_ns)
    bag = SqliteBag(tmp_path / "bag")
    for topics in ([], ["/first"]):
        read = sum(1 for _ in bag.messages(["/joint_states", *topics]))
        assert read == len(telemetry) + len(topics)
        assert "topic /joint_states: 4 malformed messages skipped" in bag.remarks[0]


def test_zero_stamps_are_rebuilt_and_reported(telemetry, tmp_path):
    delays = 2e5 + np.random.default_rng(0).exponential(1e5, len(telemetry))
    with OtherBag(tmp_path / "bag") as bag:
        other_makes.write_joint_states(bag, telemetry, stamped=False, delays=delays)
    recording = imported(tmp_path / "bag", joint_states())
    [run] = recording.runs
    assert recording.rebuilt == len(telemetry)
    assert [item.kind for item in recording.defects] == ["stamps_rebuilt"]
    # Samples and commands equal those published, at regular stamps.
    expected = np.column_stack([getattr(telemetry, name) for name in recording.stream.filled])
    assert run.values == pytest.approx(expected, rel=1e-12)
    assert np.std(np.diff(run.stamps_ns)) < 2e4


def test_interface_values_are_identified_by_names_on_another_topic(telemetry, tmp_path):
    with OtherBag(tmp_path / "bag") as bag:
        other_makes.write_interface_values(bag, telemetry)

    def of(name, **more):
        names = {"names_topic": "/broadcaster/names"}
        return source("/broadcaster/values", f"values[keys=flap/{name}]", **names, **more)

    mapping = mapping_from(
        {
            "position": of("position"),
            "speed": of("velocity", shaft="user"),
            "current": of("current"),
            "command": of("reference"),
        }
    )
    assert_same(imported(tmp_path / "bag", mapping), telemetry)


def test_odrive_messages_give_the_telemetry_except_for_its_stamps(telemetry, tmp_path):
    delays = 2e5 + np.random.default_rng(1).exponential(1e5, len(telemetry))
    with OtherBag(tmp_path / "bag") as bag:
        other_makes.write_odrive(bag, telemetry, delays)
    status = "/axis0/controller_status"
    mapping = mapping_from(
        {
            "clock": "sent",
            "position": source(status, "pos_estimate", unit="turn", shaft="motor"),
            "speed": source(status, "vel_estimate", unit="turn/s"),
            "current": source(status, "iq_measured", kind="i_q", sampling="instantaneous"),
            "command": source(
                "/axis0/control_message", "input_pos", unit="turn", shaft="motor", between="hold"
            ),
        }
    )
    recording = imported(tmp_path / "bag", mapping, replace(FLAP, drive="field_oriented"))
    [run] = recording.runs
    expected = np.column_stack([getattr(telemetry, name) for name in recording.stream.filled])
    # The messages have single precision.
    assert run.values == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert {item.kind for item in recording.defects} == {"stamps_rebuilt", "position_at_motor"}
    assert recording.description.acquisition.current == "instantaneous"


def test_mapping_of_a_bag_has_the_command_that_the_joint_follows(telemetry, tmp_path):
    with OtherBag(tmp_path / "bag") as bag:
        other_makes.write_joint_states(bag, telemetry)
    file = open_input(tmp_path / "bag")
    guess = file.guess(FLAP)
    command = source("/commands", "data[1]", between="hold")
    effort = source("/joint_states", "effort", sampling="instantaneous")
    assert guess.mapping == joint_states(clock="header", command=command, current=effort)
    assert not any("command" in remark for remark in remarks_of(guess))
    assert [item.joint for item, _ in file.recognised(UNKNOWN_JOINT)] == ["flap", "other"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"command": source("/comands", "data[1]")}, "did you mean '/commands'"),
        ({"joint": "wing"}, "'wing' is not in name, which has other, flap"),
        ({"command": source("/commands", "data[7]")}, "data has 2 elements"),
        (
            {"command": source("/commands", "data", type="std_msgs/msg/Float64")},
            "topic /commands has type std_msgs/msg/Float64MultiArray, but the mapping has",
        ),
    ],
)
def test_missing_part_of_a_bag_is_named(telemetry, tmp_path, changes, words):
    with OtherBag(tmp_path / "bag") as bag:
        other_makes.write_joint_states(bag, telemetry.part(0, 60))
    with pytest.raises(ValueError, match=r".*") as refusal:
        imported(tmp_path / "bag", joint_states(**changes))
    assert words in str(refusal.value)


def test_folder_without_a_bag_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="is not a recording"):
        open_input(tmp_path / "empty")


def other_storage(kind: str, folder: Path) -> Path:
    """Write a bag in a storage that is not supported, and return its path.

    ``kind`` is one of ``KINDS``: a folder, or the suffix of a single file.
    """
    with OtherBag(folder / "flight") as bag:
        bag.write("/topic", bag.header(START_NS), START_NS)
    [file] = (folder / "flight").glob("*.db3")
    if kind == "folder":
        return folder / "flight"
    if kind == "folder without metadata":
        (folder / "flight" / "metadata.yaml").unlink()
        return folder / "flight"
    path = folder / f"flight.{kind}"
    # For lz4, the head of the frame suffices: rosbag2 does not write lz4 files, but other plugins
    # do.
    heads = {"db3": file.read_bytes(), "mcap.lz4": b"\x04\x22\x4d\x18" + bytes(100)}
    heads["db3.zstd"] = zstandard.compress(heads["db3"])
    path.write_bytes(heads[kind])
    return path


KINDS = ("folder", "folder without metadata", "db3", "db3.zstd", "mcap.lz4")


@pytest.mark.parametrize("kind", KINDS)
def test_bag_in_another_storage_is_refused_with_the_command_that_rewrites_it(tmp_path, kind):
    with pytest.raises(ValueError, match=r"`ros2 bag convert -i BAG -o FILE`.*storage_id: mcap"):
        Bag(other_storage(kind, tmp_path))


def test_archive_refuses_bags_in_another_storage_with_the_command_that_rewrites_them(tmp_path):
    for number, kind in enumerate(KINDS[:3]):
        other_storage(kind, tmp_path / "bags" / str(number))
    archive = tmp_path / "archive"
    assert ema("archive", "scan", archive, tmp_path / "bags").exit_code == 0
    result = ema("archive", "run", archive, "--executor", "threads", "--workers", "1")
    limit_threads(None)
    assert "refused_why" in result.stderr
    question = "SELECT bag FROM refused WHERE contains(reason, '`ros2 bag convert -i BAG')"
    refused = ema("archive", "query", archive, question, "--json").stdout
    assert all(bag in refused for bag in ("0/flight", "1/flight", "2/flight.db3")), refused
