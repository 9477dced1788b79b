# SPDX-License-Identifier: Apache-2.0
"""Telemetry with arbitrary content causes no traceback and does not affect later windows."""

import itertools
import math
import random
import struct

import pytest
from rclpy.serialization import serialize_message

from ema_interfaces.msg import TelemetryBlock
from ema_ros import topics

from .monitor_session import FLAP, Source, monitor

STAMPS = (-(2**31), -1, 0, 1, 2**31 - 1)
NANOSECONDS = (0, 999_999_999, 2**32 - 1)
INDICES = (0, 1, 2**31, 2**63 - 1, 2**63, 2**64 - 101, 2**64 - 1)
PERIODS = (1e-4, 0.0, -1e-4, 1e-300, 1e-9, 1.0, 1e300, math.inf, math.nan)
VALUES = (0.0, 1e308, -1e308, 5e-324, math.inf, math.nan)


def hostile(rng: random.Random) -> TelemetryBlock:
    """Return a block with random fields; each field alone is possible in a message."""
    message = TelemetryBlock(actuator_id=rng.choice([FLAP.actuator_id] * 8 + ["", "a" * 999, "x"]))
    message.header.stamp.sec = rng.choice(STAMPS)
    message.header.stamp.nanosec = rng.choice(NANOSECONDS)
    message.first_index = rng.choice(INDICES)
    message.sample_period = rng.choice(PERIODS if rng.random() < 0.5 else PERIODS[:1])
    length = rng.choice([0, 1, 2, 100])
    for name in ("command", "current", "position", "speed"):
        samples = length if rng.random() < 0.9 else rng.randrange(5)
        fill = rng.choice(VALUES) if rng.random() < 0.3 else 0.0
        getattr(message, name).extend(rng.gauss(0.0, 1e-3) + fill for _ in range(samples))
    return message


@pytest.mark.slow
@pytest.mark.parametrize("windows", ["test_cycle", "any_motion"])
def test_hostile_telemetry_causes_no_traceback_and_affects_no_later_window(
    capfd: pytest.CaptureFixture[str], windows: str
):
    rng, source = random.Random(17), Source()
    with monitor({"windows": windows, "window_s": 0.01, "rest_s": 0.001}) as session:
        session.describe(FLAP)
        for number in range(400):
            message = hostile(rng)
            session.send(topics.TELEMETRY, message)
            if number % 100 == 0:
                session.until_status("input", "", since=len(session.statuses("input")))
        seen = len(session.estimates())
        session.set_parameters(windows="test_cycle", window_s=0.5, rest_s=0.02)
        session.feed(source.cycle())
        session.until(
            lambda: [estimate for estimate in session.estimates()[seen:] if estimate.valid]
        )
    text = "".join(capfd.readouterr())
    assert "Traceback" not in text
    assert "failed" not in text


def test_malformed_serialised_messages_are_ignored(capfd: pytest.CaptureFixture[str]):
    whole = serialize_message(hostile(random.Random(1)))
    torn = [whole[:size] for size in (1, 3, 4, 5, 8, 20, len(whole) - 9)]
    # Lengths of sequences and texts that exceed the data.
    huge = [b"\x00\x01\x00\x00" + bytes(8) + struct.pack("<I", size) for size in (2**31, 2**32 - 1)]
    source = Source()
    with monitor() as session:
        session.describe(FLAP)
        for data in itertools.chain(torn, huge, [b"\xff" * 200]):
            for topic in (topics.TELEMETRY, topics.DESCRIPTION, topics.USAGE):
                session._publishers[topic].publish(data)
        session.feed(source.cycle())
        assert session.next_estimate().valid
    assert "Traceback" not in "".join(capfd.readouterr())
