# SPDX-License-Identifier: Apache-2.0
"""``ema recover`` writes the intact messages of a damaged bag to a whole one."""

from pathlib import Path

from mcap.writer import Writer
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from ema_bags.reader import Bag

from ..commands import SAMPLE


def test_recovered_bag_is_whole_and_holds_every_intact_message(ema, tmp_path: Path):
    damaged = tmp_path / "killed.mcap"
    content = SAMPLE.read_bytes()
    damaged.write_bytes(content[: len(content) * 2 // 3])
    result = ema("recover", damaged, "-o", tmp_path / "whole")
    assert result.exit_code == 0, result.output
    before, after = Bag(damaged), Bag(tmp_path / "whole")
    assert before.damage
    assert "killed.mcap" in result.stderr
    assert after.damage == ""
    recovered, expected = ([item[1:] for item in bag.raw_messages()] for bag in (after, before))
    assert recovered == expected
    assert {name: (t.qos, t.type_hash) for name, t in after.topics.items()} == {
        name: (t.qos, t.type_hash) for name, t in before.topics.items()
    }
    assert f"{sum(t.count for t in after.topics.values())} messages on 5 topics" in result.stdout
    again = ema("recover", damaged, "-o", tmp_path / "whole")
    assert (again.exit_code, "already exists" in again.stderr) == (1, True)


def test_message_with_a_time_that_ros_cannot_represent_is_left_out_and_reported(
    ema, tmp_path: Path
):
    path = tmp_path / "strange.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "another program")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        channel = writer.register_channel("/words", "cdr", schema)
        for log_ns, publish_ns in ((1, 1), (2, 2**63), (2**63, 3), (2**63 - 1, 4)):
            data = serialize_message(String(data=str(publish_ns)))
            writer.add_message(channel, log_ns, data, publish_ns)
        writer.finish()
    result = ema("recover", path, "-o", tmp_path / "whole")
    assert result.exit_code == 0, result.output
    assert "2 malformed" in result.stderr
    whole = Bag(tmp_path / "whole")
    assert [
        (raw_message.log_time_ns, raw_message.publish_time_ns)
        for raw_message in whole.raw_messages()
    ] == [(1, 1), (2**63 - 1, 4)]
