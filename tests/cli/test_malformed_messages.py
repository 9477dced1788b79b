# SPDX-License-Identifier: Apache-2.0
"""A malformed message affects only itself and the window that it interrupts."""

import array
from pathlib import Path

import pytest

from ema_bags.message_type import message_class
from ema_bags.qos import joint_offer, recorded_qos
from ema_bags.reader import Bag
from ema_bags.telemetry import DESCRIPTION_TYPE, TELEMETRY_TYPE
from ema_bags.writer import BagWriter

from ..bags.recorded_messages import ros_messages
from ..commands import SAMPLE

pytestmark = pytest.mark.slow
NOT_CDR = b"\x00\x01\x00\x00\x07\xff"


def spoil(source: Path, target: Path) -> dict[str, int]:
    """Copy a bag with malformed messages on each topic; return their number by topic."""
    bag = Bag(source)
    malformed = dict.fromkeys(bag.topics, 1)
    with BagWriter(target) as writer:
        for name, topic in bag.topics.items():
            kind = message_class(topic.type_name)
            writer.add_topic(name, kind, joint_offer(recorded_qos(topic.qos)))
        log_time_ns = bag.start_ns or 0
        for name in bag.topics:
            writer.write_serialized(name, NOT_CDR, log_time_ns)
        for number, item in enumerate(ros_messages(bag)):
            writer.write(item.topic, item.message, item.log_time_ns, item.publish_time_ns)
            if number == 10:  # while the actuator rests
                block = message_class(TELEMETRY_TYPE)(actuator_id="flap", sample_period=1e-4)
                block.command = array.array("d", [0.0] * 5)
                block.position = array.array("d", [0.0])
                writer.write(bag.topics_of(TELEMETRY_TYPE)[0], block, item.log_time_ns)
                malformed[bag.topics_of(TELEMETRY_TYPE)[0]] += 1
                [described] = bag.topics_of(DESCRIPTION_TYPE)
                message = next(record.message for record in ros_messages(bag, [described]))
                message.gear_ratio = -1.0
                writer.write(described, message, item.log_time_ns)
    return malformed


@pytest.fixture(scope="module")
def spoiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("spoiled") / "spoiled.mcap"
    spoil(SAMPLE, path)
    return path


@pytest.mark.parametrize(
    "arguments",
    [
        ("info",),
        ("estimate",),
        ("plot", "-o", "out.png"),
        ("compare", "--algorithms", "least_squares"),
        ("predict", "--hours-per-cycle", "10"),
        ("report", "-o", "out.html"),
        ("calibrate", "--accept-defects", "--accepted-by", "Ada", "-o", "out.yaml"),
    ],
    ids=" ".join,
)
def test_command_names_what_is_malformed_and_continues(
    ema, spoiled: Path, tmp_path: Path, arguments: tuple[str, ...]
):
    command, *options = (
        tmp_path / argument if argument.startswith("out") else argument for argument in arguments
    )
    result = ema(command, spoiled, *options)
    assert result.exit_code == 0, result.output
    reported = " ".join(result.output.split())
    start_ns = Bag(SAMPLE).start_ns
    if command == "report":
        reported = " ".join((tmp_path / "out.html").read_text().split())
    for topic, count in (("telemetry", "2 malformed messages"), ("actuator_description", "2 malf")):
        assert f"topic /ema/{topic}: {count}" in reported
    assert f"the first of log time {start_ns} ns: " in reported


def test_recovered_bag_has_no_malformed_messages(ema, spoiled: Path, tmp_path: Path):
    result = ema("recover", spoiled, "-o", tmp_path / "whole.mcap")
    assert result.exit_code == 0, result.output
    assert "topic /ema/telemetry: 2 malformed messages skipped" in result.stderr
    whole = Bag(tmp_path / "whole.mcap")
    list(whole.messages())
    assert whole.damage == ""
    # An impossible description is a well-formed message; only its reader can judge it.
    assert whole.topics["/ema/actuator_description"].count == 2
    assert whole.topics["/ema/telemetry"].count == Bag(SAMPLE).topics["/ema/telemetry"].count
