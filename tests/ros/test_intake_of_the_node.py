# SPDX-License-Identifier: Apache-2.0
"""The node and a monitor without ROS store the same tests: estimate, count and duty."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ema_interfaces.msg import HiddenCause, MeasuredCauses
from ema_monitor import Count, Monitor, MonitorSettings
from ema_monitor.prognosis.history_entry import Entry
from ema_ros import topics
from ema_ros.actuator_messages import usage_at_cycle
from ema_ros.stamps import stamp_to_message

from ..waiting import wait_for
from .monitor_session import FLAP, Source, monitor

CYCLES = 3
MAX_AGE_S = 1.0
RISE_K = 20.0


def plain(entry: Entry) -> dict[str, Any]:
    """Return a test as plain values to compare bit by bit, without its computing time."""
    estimate = replace(entry.estimate, computing_time=0.0)
    values = asdict(replace(entry, estimate=estimate, shift_ns=0))
    values["flown"] = asdict(entry.flown)
    return values


def test_node_and_monitor_give_a_unit_the_same_tests():
    source = Source(friction=0.1)
    alone = Monitor(FLAP, settings=MonitorSettings(measured_max_age_s=MAX_AGE_S))
    with monitor({"measured_max_age_s": MAX_AGE_S}) as session:
        session.mount()
        sources = session.node.sources
        for number in range(CYCLES):
            blocks = source.cycle()
            begin_ns, hours = blocks[0].stamp_ns, 100.0 * number
            causes = MeasuredCauses(actuator_id=FLAP.actuator_id)
            causes.causes = [
                HiddenCause(name="winding_temperature", value=RISE_K, sigma=1.0, unit="K")
            ]
            causes.header.stamp = stamp_to_message(begin_ns)
            session.send(topics.MEASURED_CAUSES, causes)
            session.send(topics.USAGE, usage_at_cycle(FLAP, begin_ns, hours, number))
            wait_for(
                lambda stamp_ns=begin_ns, hours=hours: (
                    sources.measurements.at("flap", stamp_ns, MAX_AGE_S)
                    and (count := sources.counts.latest(FLAP.unit_key, stamp_ns))
                    and count.hours == hours
                ),
                "the measurement and the count",
            )
            session.feed(blocks)
            session.next_estimate()
            alone.measure(begin_ns, {"winding_temperature": (RISE_K, 1.0)})
            alone.count(Count(begin_ns, hours, number + 1))
            for block in blocks:
                list(alone.feed(block))
        live = session.node.histories.of(FLAP)
        wait_for(lambda: len(live.history.entries) == CYCLES, "the history")
        entries = live.history.entries
        for node_entry, monitor_entry in zip(entries, alone.unit.history.entries, strict=True):
            assert node_entry.count is not None
            assert node_entry.flown.hours > 0.0
            assert node_entry.flown.winding[1].sum() > 0.0
            np.testing.assert_equal(plain(node_entry), plain(monitor_entry))
