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


def test_gaps_count_where_one_publisher_stays():
    gaps = SequenceGaps()
    gaps.set_publishers(frozenset("a"))
    for number in (7, 8, 11, None, 12):
        gaps.count(number)
    assert gaps.lost == 0  # until the publisher is seen to be the same
    gaps.set_publishers(frozenset("a"))
    assert gaps.lost == 2
    gaps.set_publishers(frozenset("a"))
    assert gaps.lost == 2


def test_what_a_publisher_sent_while_it_was_out_of_reach_counts_as_lost():
    gaps = SequenceGaps()
    gaps.set_publishers(frozenset("a"))
    gaps.count(100)
    gaps.set_publishers(frozenset())
    gaps.count(1101)
    gaps.set_publishers(frozenset("a"))
    assert gaps.lost == 1000
    # Another one in its place has numbers of its own.
    gaps.set_publishers(frozenset())
    gaps.count(5000)
    gaps.set_publishers(frozenset("b"))
    gaps.set_publishers(frozenset("b"))
    assert gaps.lost == 1000


def test_what_comes_while_nothing_is_recorded_is_not_lost():
    gaps = SequenceGaps()
    gaps.set_publishers(frozenset("a"))
    gaps.count(1)
    gaps.pause()
    gaps.count(1001)
    gaps.set_publishers(frozenset("a"))
    assert gaps.lost == 0


def test_gap_before_the_last_message_of_a_publisher_counts_when_it_has_gone():
    gaps = SequenceGaps()
    gaps.set_publishers(frozenset("a"))
    gaps.count(1)
    gaps.count(7)
    for _ in range(2):
        gaps.set_publishers(frozenset())
        assert gaps.lost == 5


def test_gaps_of_several_or_new_publishers_do_not_count():
    gaps = SequenceGaps()
    gaps.set_publishers(frozenset("a"))
    gaps.count(100)
    for number in (1, 101, 2):  # a second publisher that is not seen yet
        gaps.count(number)
    for publishers in ("ab", "ab", "b", "ab", "", "a"):
        gaps.set_publishers(frozenset(publishers))
        if len(publishers) != 1:
            for number in (10, 9000, 11, 9001):
                gaps.count(number)
    gaps.set_publishers(frozenset("c"))
    gaps.count(1)  # a publisher that starts anew
    gaps.set_publishers(frozenset("c"))
    assert gaps.lost == 0


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
