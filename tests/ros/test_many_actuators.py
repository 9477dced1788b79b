# SPDX-License-Identifier: Apache-2.0
"""Many actuators: the limit, lists, and sharing between several monitors."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from rclpy.parameter import Parameter

from ema_core.levels import WARN
from ema_interfaces.msg import Health
from ema_interfaces.srv import GetHistory
from ema_monitor.node.monitor_node import MonitorNode
from ema_monitor.node.receive.admission import shard_of
from ema_ros import topics
from ema_ros.executor import NodeExecutor

from .monitor_session import FLAP, MonitorSession, Source, monitor
from .spinning import end, made, spinning, wait_for_match


def described(actuator_id: str):
    return replace(FLAP, actuator_id=actuator_id)


def figure(session: MonitorSession, key: str) -> str:
    values = session.statuses("input")[-1].values
    return next(item.value for item in values if item.key == key)


def reports(session: MonitorSession) -> list[set[str]]:
    """Return the tasks in each report with the telemetry of tab, but without ``lifecycle``."""
    names_of_reports = [
        {status.name.removeprefix("/ema/monitor: ") for status in array.status}
        for array in session.received("/diagnostics")
    ]
    return [
        names for names in names_of_reports if "tab telemetry" in names and "lifecycle" not in names
    ]


def get_history(session: MonitorSession, actuator_id: str, node: str = "monitor"):
    request = GetHistory.Request(actuator_id=actuator_id)
    return session.call(GetHistory, f"/ema/{node}/get_history", request)


def test_actuator_beyond_the_limit_is_followed_after_the_limit_is_raised():
    with monitor({"most_actuators": 1}) as session:
        session.describe()
        session.until_status("flap telemetry", "no telemetry so far")
        session.describe_latched(described("tab"))
        blocks = Source().cycle()
        session.feed(blocks[:2], "tab")
        session.until_status(
            "input", "ignored: 3 messages of actuators beyond the limit", bytes([WARN])
        )
        assert not session.statuses("tab telemetry")
        assert "'tab' is not monitored" in get_history(session, "tab").message
        assert session.set_parameters(most_actuators=2)[0].successful
        # The latched description is not sent again.
        session.feed(blocks[2:], "tab")
        session.until(lambda: session.estimates("tab"))
        assert set(session.node.actuators) == {"flap", "tab"}
        # An actuator's status is reported after its estimate, and all statuses once per second.
        [changed, *_] = session.until(lambda: reports(session))
        assert {"tab telemetry", "tab history", "input", "identification"} <= changed
        assert not {"flap telemetry", "lifecycle"} & changed


def test_only_listed_actuators_are_followed_and_silent_ones_are_reported():
    with monitor({"actuators": ["flap", "rudder"]}) as session:
        session.until_status("rudder telemetry", "listed, but nothing received", bytes([WARN]))
        blocks = Source().cycle()
        session.describe_latched(described("tab"))
        session.feed(blocks[:2], "tab")
        session.describe()
        session.feed(blocks[:2])
        session.until(lambda: figure(session, "messages of unlisted actuators") == "3")
        session.until_status("input", "2 actuators monitored")
        assert set(session.node.actuators) == {"flap", "rudder"}
        assert "not listed in the parameter actuators" in get_history(session, "tab").message


def test_monitors_share_actuators_and_one_folder_without_a_common_file(tmp_path: Path):
    names = [f"tab_{number}" for number in range(4)]
    shards = {name: shard_of(name, 2) for name in names}
    assert set(shards.values()) == {0, 1}
    common = {"history_folder": str(tmp_path), "shard.count": 2, "expected_period_s": 1000.0}
    common["history_max_offset_s"] = 1e10  # the stamps are long ago
    with monitor({**common, "shard.index": 0}) as session, ExitStack() as opened:
        overrides = [Parameter(k, value=v) for k, v in {**common, "shard.index": 1}.items()]
        second_node = made(
            MonitorNode,
            context=session.node.context,
            namespace="/ema",
            parameter_overrides=overrides,
            cli_args=["--ros-args", "-r", "__node:=monitor_1"],
        )
        opened.callback(end, second_node)
        executor = NodeExecutor(session.fail, context=session.node.context)
        opened.enter_context(spinning(executor, second_node))
        opened.callback(second_node.stopping.set)
        assert second_node.bring_up()
        arrived = (topics.TELEMETRY, topics.DESCRIPTION)
        wait_for_match(second_node, *(session._publishers[name] for name in arrived))
        session.subscribe(Health, topics.HEALTH, topics.LATCHED_BY_MANY, key="all")
        for name in names:
            session.describe_latched(described(name))
            session.feed(Source().cycle(), name)
        session.until(lambda: {item.actuator_id for item in session.received("all")} == set(names))
        assert [len(session.estimates(name)) for name in names] == [1] * 4
        followed = [set(node.actuators) for node in (session.node, second_node)]
        assert followed == [{n for n in names if shards[n] == shard} for shard in (0, 1)]
        # Each status comes from one node, and one node writes the file of a unit.
        nodes = {0: "/ema/monitor", 1: "/ema/monitor_1"}

        def printed() -> set[str]:
            return {s.name for array in session.received("/diagnostics") for s in array.status}

        session.until(
            lambda: {f"{nodes[shards[name]]}: {name} history" for name in names} <= printed()
        )
        for name in names:
            assert f"{nodes[1 - shards[name]]}: {name} health" not in printed()
            history = session.statuses(f"{name} history")[-1:]
            assert all(status.level == b"\0" for status in history)
        files = sorted(path.name for path in tmp_path.glob("*.sqlite"))
        assert files == [f"{name}+{FLAP.serial_number}.sqlite" for name in names]
        mine, theirs = (next(n for n in names if shards[n] == shard) for shard in (0, 1))
        assert get_history(session, mine).success
        assert get_history(session, theirs, "monitor_1").success
        refused = get_history(session, theirs)
        assert "it belongs to shard 1, this monitor has shard 0 of 2" in refused.message
