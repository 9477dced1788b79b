# SPDX-License-Identifier: Apache-2.0
"""Lost messages are counted by sequence numbers, and qualities of service are read back."""

import pytest
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.serialization import serialize_message

from ema_bags.qos import offered_qos, offered_qos_profiles, recorded_qos, replay_qos
from ema_bags.recorded_topic import SampleGaps, SequenceGaps
from ema_interfaces.msg import TelemetryBlock
from ema_ros.topics import ALIVE, ALIVE_BY_MANY

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STREAM = QoSProfile(depth=500)
BEST_EFFORT = QoSProfile(depth=500, reliability=ReliabilityPolicy.BEST_EFFORT)


PAUSE = "pause"
OF_TWO = (10, 9000, 11, 9001)
SEVERAL = ("ab", *OF_TWO)


@pytest.mark.parametrize(
    ("events", "lost"),
    [
        # Numbers count once the publisher is known to be the same.
        (("a", 7, 8, 11, None, 12), 0),
        (("a", 7, 8, 11, None, 12, "a"), 2),
        (("a", 7, 8, 11, None, 12, "a", "a"), 2),
        # Messages sent while the publisher was unreachable are lost; a new publisher has its own
        # numbers.
        (("a", 100, "", 1101, "a"), 1000),
        (("a", 100, "", 1101, "a", "", 5000, "b", "b"), 1000),
        (("a", 1, PAUSE, 1001, "a"), 0),
        # A gap before the last message counts after the publisher has left.
        (("a", 1, 7, ""), 5),
        (("a", 1, 7, "", ""), 5),
        # A second, undiscovered publisher; several publishers; and a publisher that restarts.
        (
            ("a", 100, 1, 101, 2, *SEVERAL, *SEVERAL, "b", *SEVERAL, "", *OF_TWO, "a", "c", 1, "c"),
            0,
        ),
    ],
)
def test_gaps_count_if_the_publisher_stays_the_same(
    events: tuple[str | int | None, ...], lost: int
):
    """Discovered publishers are given as letters, with the sequence numbers received."""
    gaps = SequenceGaps()
    for event in events:
        if event == PAUSE:
            gaps.pause()
        elif isinstance(event, str):
            gaps.set_publishers(frozenset(event))
        else:
            gaps.count(event)
    assert gaps.lost == lost


def received(gaps: SampleGaps, now_s: float, *indices: int, name: str = "flap") -> None:
    """Count blocks of ten samples with the given first indices."""
    for first_index in indices:
        block = TelemetryBlock(actuator_id=name, first_index=first_index, position=[0.0] * 10)
        gaps.count(bytes(serialize_message(block)), now_s)


def test_missing_blocks_and_shared_names_are_counted_per_actuator():
    gaps = SampleGaps()
    received(gaps, 100.0, 500, 90_000, 510, 90_010, 540, 90_050, 550, 90_060)
    received(gaps, 100.0, 0, 10, name="rudder")
    assert gaps.shared == ["flap"]
    received(gaps, 106.0, 90_070)
    gaps.settle(106.0)
    assert (gaps.lost, gaps.shared) == (2 + 3, [])


def test_no_block_is_missing_after_a_pause_or_with_a_single_publisher():
    gaps = SampleGaps()
    received(gaps, 100.0, 0)
    gaps.pause()
    received(gaps, 100.0, 1000, 2000)
    gaps.ignore()
    gaps.count(b"no message", 100.0)
    gaps.count(bytes(serialize_message(TelemetryBlock(actuator_id="flap"))), 100.0)
    received(gaps, 110.0, 2010)
    gaps.settle(110.0)
    assert gaps.lost == 0


@pytest.mark.parametrize("numbers", [False, True])
def test_recorded_qos_is_read_back(numbers: bool):
    for qos in (STREAM, LATCHED, BEST_EFFORT, ALIVE):
        text = offered_qos_profiles(qos)
        if numbers:  # as in recordings before Jazzy
            text = text.replace("keep_last", "1").replace("automatic", "1")
            text = text.replace("reliable", "1").replace("best_effort", "2")
            text = text.replace("transient_local", "1").replace("volatile", "2")
        (read,) = recorded_qos(text)
        assert offered_qos(read) == offered_qos(qos)
    assert recorded_qos("") == []
    with pytest.raises(ValueError, match="offered_qos_profiles"):
        recorded_qos("- history: keep_some\n")


def test_replayed_qos_keeps_latched_messages_and_widens_streams():
    assert replay_qos([LATCHED]).depth == 1
    assert replay_qos([LATCHED]).durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert replay_qos([STREAM]).depth == 1000
    assert replay_qos([STREAM]).durability == DurabilityPolicy.VOLATILE
    assert replay_qos([BEST_EFFORT]).reliability == ReliabilityPolicy.BEST_EFFORT
    assert replay_qos([LATCHED, STREAM]).durability == DurabilityPolicy.VOLATILE
    assert replay_qos([]).reliability == ReliabilityPolicy.RELIABLE


@pytest.mark.parametrize("recorded", [(), (LATCHED,), (ALIVE,), (ALIVE, ALIVE), (ALIVE, LATCHED)])
def test_played_health_asserts_liveliness_even_if_the_recorded_did_not(
    recorded: tuple[QoSProfile, ...],
):
    """A recording of another version has health without a lease."""
    offered = replay_qos(recorded or (LATCHED,))
    assert qos_check_compatible(offered, ALIVE_BY_MANY) == (QoSCompatibility.OK, "")
    assert replay_qos(()).liveliness_lease_duration == ALIVE.liveliness_lease_duration
    soon = QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=1))
    assert replay_qos((soon,)).liveliness_lease_duration == Duration(seconds=1)
