# SPDX-License-Identifier: Apache-2.0
"""Losses are counted by sequence numbers, and qualities of service are read back."""

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message

from ema_bags.qos import offered_qos, offered_qos_profiles, recorded_qos, replay_qos
from ema_bags.recorded_topic import SampleGaps, SequenceGaps
from ema_interfaces.msg import TelemetryBlock

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM = QoSProfile(depth=500)
BEST_EFFORT = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)


PAUSE = "pause"
OF_TWO = (10, 9000, 11, 9001)
SEVERAL = ("ab", *OF_TWO)


@pytest.mark.parametrize(
    ("events", "lost"),
    [
        # Numbers count once the publisher is seen to be the same.
        (("a", 7, 8, 11, None, 12), 0),
        (("a", 7, 8, 11, None, 12, "a"), 2),
        (("a", 7, 8, 11, None, 12, "a", "a"), 2),
        # What it sent while it was out of reach is lost; another in its place has its own numbers.
        (("a", 100, "", 1101, "a"), 1000),
        (("a", 100, "", 1101, "a", "", 5000, "b", "b"), 1000),
        (("a", 1, PAUSE, 1001, "a"), 0),
        # A gap before the last message counts when the publisher has gone.
        (("a", 1, 7, ""), 5),
        (("a", 1, 7, "", ""), 5),
        # A second publisher that is not seen yet, several, and one that starts anew.
        (
            ("a", 100, 1, 101, 2, *SEVERAL, *SEVERAL, "b", *SEVERAL, "", *OF_TWO, "a", "c", 1, "c"),
            0,
        ),
    ],
)
def test_gaps_count_where_one_publisher_stays(events: tuple[str | int | None, ...], lost: int):
    """Of publishers that are seen, one letter each, and sequence numbers."""
    gaps = SequenceGaps()
    for event in events:
        if event == PAUSE:
            gaps.pause()
        elif isinstance(event, str):
            gaps.set_publishers(frozenset(event))
        else:
            gaps.count(event)
    assert gaps.lost == lost


def test_blocks_that_are_missing_count_by_the_index_of_their_samples():
    gaps = SampleGaps()

    def receive(actuator_id: str, first_index: int, length: int = 10) -> int:
        block = TelemetryBlock(
            actuator_id=actuator_id, first_index=first_index, position=[0.0] * length
        )
        gaps.count(bytes(serialize_message(block)))
        return gaps.lost

    assert [receive("left", index) for index in (500, 510, 540)] == [0, 0, 2]
    assert [receive("right", index) for index in (7, 17, 32)] == [2, 2, 3]  # half a block is one
    assert receive("left", 0) == 3  # started again
    assert receive("left", 20, 0) == 3
    gaps.count(b"no message")
    gaps.pause()
    assert receive("left", 1000) == 3


@pytest.mark.parametrize("numbers", [False, True])
def test_recorded_qos_is_read_back(numbers: bool):
    for qos in (STREAM, LATCHED, BEST_EFFORT):
        text = offered_qos_profiles(qos)
        if numbers:  # as recordings before Jazzy have it
            text = text.replace("keep_last", "1").replace("automatic", "1")
            text = text.replace("reliable", "1").replace("best_effort", "2")
            text = text.replace("transient_local", "1").replace("volatile", "2")
        (read,) = recorded_qos(text)
        assert offered_qos(read) == offered_qos(qos)
    assert recorded_qos("") == []
    with pytest.raises(ValueError, match="offered_qos_profiles"):
        recorded_qos("- history: keep_some\n")


def test_replayed_qos_keeps_what_is_latched_and_widens_streams():
    assert replay_qos([LATCHED]).depth == 1
    assert replay_qos([LATCHED]).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert replay_qos([STREAM]).depth == 1000
    assert replay_qos([STREAM]).durability == DurabilityPolicy.VOLATILE
    assert replay_qos([BEST_EFFORT]).reliability == ReliabilityPolicy.BEST_EFFORT
    assert replay_qos([LATCHED, STREAM]).durability == DurabilityPolicy.VOLATILE
    assert replay_qos([]).reliability == ReliabilityPolicy.RELIABLE
