"""A bag that somebody removes while it is recorded is told, and recording goes on in a new file."""

import shutil
from pathlib import Path

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ema_bags.reader import Bag
from ema_bags.writer import BagWriter
from ema_interfaces.msg import ActuatorDescription
from ema_ros import topics

from ..waiting import wait_for


@pytest.mark.parametrize("name", ["one.mcap", "folder"])
def test_recording_goes_on_in_a_new_file(tmp_path: Path, name: str):
    path = tmp_path / "bags" / name
    with BagWriter(path, flush_s=0.1, waits_for_room=True) as bag:
        bag.add_topic("/words", String, QoSProfile(depth=10))
        bag.add_topic("/ema/actuator_description", ActuatorDescription, topics.LATCHED)
        bag.write("/ema/actuator_description", ActuatorDescription(actuator_id="flap"), 5)
        for number in range(3):
            bag.write("/words", String(data="before"), 10 + number)
        bag.flush()
        shutil.rmtree(path.parent)
        wait_for(lambda: bag.removed, "the removal is noticed")
        assert bag.failure is None
        bag.write("/words", String(data="after"), 20)
    [removed] = bag.removed
    assert removed.startswith("4 messages from 0.000 s to 0.000 s not recorded: ")
    assert "was removed or moved while it was recorded" in removed
    found = Bag(path)
    assert found.damage == ""
    assert [one.message.data for one in found.messages(["/words"])] == ["after"]
    [described] = found.messages(["/ema/actuator_description"])
    assert described.message.actuator_id == "flap"
    assert found.topics["/words"].count == 1
    assert found.gaps[0].messages == 4


def test_bag_that_does_not_wait_is_an_error(tmp_path: Path):
    path = tmp_path / "one.mcap"
    bag = BagWriter(path)
    bag.add_topic("/words", String, QoSProfile(depth=10))
    path.unlink()
    with pytest.raises(FileNotFoundError, match="was removed or moved while it was recorded"):
        bag.flush()
    with pytest.raises(FileNotFoundError):
        bag.close()
