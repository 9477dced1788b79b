# SPDX-License-Identifier: Apache-2.0
"""A monitor in the test process, with a probe that communicates with it like other nodes."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.action.client import ActionClient
from rclpy.context import Context
from rclpy.parameter import Parameter

from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.domains import Domain
from ema_core.faults import fault_vector
from ema_core.telemetry import Telemetry
from ema_interfaces.action import IdentifyFaults
from ema_interfaces.msg import FaultEstimate, Health
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.node.monitor_node import MonitorNode
from ema_monitor.prognosis.requirements.requirements import RequirementLimits, requirements_of
from ema_ros import topics
from ema_ros.messages import description_to_message, telemetry_to_message
from ema_sim.actuator import SimulatedActuator

from ..waiting import DEADLINE_S, wait_for
from .spinning import Probe, probed, wait_for_match, where_it_spins

START_NS = 1_700_000_000_000_000_000
ANY_OFFSET_S = 1e10
FLAP = ActuatorDescription()
CYCLE = build_cycle(THESIS_CHIRP, FLAP.sample_period)


class Source:
    """Telemetry of a simulated actuator in consecutive test cycles."""

    def __init__(self, *, stamp_ns: int = START_NS, **faults: float) -> None:
        self.actuator = SimulatedActuator(stamp_ns=stamp_ns)
        self.set(**faults)

    def set(self, **faults: float) -> None:
        """Set the faults of the next cycles; components that are not named are healthy."""
        self.actuator.faults = fault_vector(faults)

    def cycle(self, size: int = 500) -> list[Telemetry]:
        """Return the next test cycle in blocks of ``size`` samples."""
        whole = self.actuator.advance(CYCLE.samples)
        stops = [*range(size, len(whole), size), len(whole)]
        return [whole.part(start, stop) for start, stop in zip([0, *stops], stops, strict=False)]


def in_window(blocks: list[Telemetry]) -> int:
    """Return the index of the block in the middle of the window of a cycle."""
    middle = blocks[0].first_index + (CYCLE.start + CYCLE.stop) // 2
    return next(i for i, b in enumerate(blocks) if b.first_index + len(b) > middle)


def corrupted(block: Telemetry, column: str, sample: int, value: float) -> Telemetry:
    """Return a block with one sample of a column replaced."""
    values = getattr(block, column).copy()
    values[sample] = value
    return replace(block, **{column: values})


class MonitorSession(Probe):
    """A monitor node and a probe, both spun in the background."""

    def __init__(self, context: Context, node: MonitorNode) -> None:
        super().__init__(context, node)
        self._estimates_awaited = 0
        self._at_end: list[Callable[[], Any]] = []
        self._publishers = {
            name: self.probe.create_publisher(message_class, name, qos)
            for name, (message_class, qos) in (
                topics.ACTUATOR_TOPICS | topics.SYSTEM_TOPICS
            ).items()
        }
        for name, (message_class, qos) in topics.MONITOR_TOPICS.items():
            self.subscribe(message_class, name, qos)

    def at_end(self, callback: Callable[[], Any]) -> None:
        """Register a function to call before the probe is destroyed."""
        self._at_end.append(callback)

    def close(self) -> None:
        for callback in self._at_end:
            callback()

    def bring_up(self) -> None:
        """Configure and activate the node, and wait until its subscriptions are matched."""
        assert self.node.bring_up()
        self.until_subscribed()

    def until_subscribed(self) -> None:
        names = (topics.TELEMETRY, topics.DESCRIPTION, topics.MEASURED_CAUSES)
        wait_for_match(self.node, *(self._publishers[name] for name in names))

    def describe(self, description: ActuatorDescription = FLAP) -> None:
        self.send(topics.DESCRIPTION, description_to_message(description))

    def mount(self, description: ActuatorDescription = FLAP) -> None:
        """Publish a description, and wait until the monitor has it."""
        actuators = self.node.actuators
        self.describe(description)
        wait_for(
            lambda: "flap" in actuators and actuators["flap"].description == description,
            "the description",
        )

    def describe_latched(self, description: ActuatorDescription) -> None:
        """Publish a latched description by another publisher, as another actuator does."""
        message_class, qos = topics.ACTUATOR_TOPICS[topics.DESCRIPTION]
        publisher = self.probe.create_publisher(message_class, topics.DESCRIPTION, qos)
        publisher.publish(description_to_message(description))

    def feed(self, blocks: Iterable[Telemetry], actuator_id: str = FLAP.actuator_id) -> None:
        for block in blocks:
            self.send(topics.TELEMETRY, telemetry_to_message(block, actuator_id))

    def send(self, topic: str, message: Any) -> None:
        self._publishers[topic].publish(message)

    def estimates(self, actuator_id: str = FLAP.actuator_id) -> list[FaultEstimate]:
        received = self.received(topics.FAULT_ESTIMATE)
        return [item for item in received if item.actuator_id == actuator_id]

    def healths(self, actuator_id: str = FLAP.actuator_id) -> list[Health]:
        return [item for item in self.received(topics.HEALTH) if item.actuator_id == actuator_id]

    def next_estimate(self, timeout_s: float = DEADLINE_S) -> FaultEstimate:
        """Wait for the next estimate that this method has not returned yet."""
        self._estimates_awaited += 1
        number = self._estimates_awaited
        return self.until(lambda: self.estimates()[number - 1 : number], timeout_s)[0]

    def change_state(self, transition: int) -> bool:
        request = ChangeState.Request()
        request.transition.id = transition
        return self.call(ChangeState, "/ema/monitor/change_state", request).success

    def set_parameters(self, **values: Any) -> list[Any]:
        """Set parameters by the service of the node, and return the results."""
        request = SetParameters.Request(
            parameters=[
                Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
            ]
        )
        return self.call(SetParameters, "/ema/monitor/set_parameters", request).results


class Goal:
    """A goal sent to an action of a monitor, by default ``identify_faults``."""

    def __init__(
        self,
        session: MonitorSession,
        kind: Any = IdentifyFaults,
        name: str = "identify_faults",
        **goal: Any,
    ) -> None:
        self.feedback: list[Any] = []
        self._session = session
        self._client = ActionClient(session.probe, kind, f"/ema/monitor/{name}")
        wait_for(self._client.server_is_ready, "the action")
        request = kind.Goal(**goal)
        sent = self._ask(lambda: self._client.send_goal_async(request, self._note))
        self.handle = session.result(sent)
        session.at_end(self._client.destroy)
        self.is_accepted = self.handle.accepted
        self._result = self._ask(self.handle.get_result_async) if self.is_accepted else None

    def _ask(self, call: Callable[[], Any]) -> Any:
        return where_it_spins(self._session.probe, call)

    def _note(self, message: Any) -> None:
        self.feedback.append(message.feedback)

    def cancel(self) -> None:
        self._session.result(self._ask(self.handle.cancel_goal_async))

    def result(self) -> tuple[int, Any]:
        answer = self._session.result(self._result)
        return answer.status, answer.result


@contextmanager
def monitor(
    parameters: dict[str, Any] | None = None, *, up: bool = True
) -> Iterator[MonitorSession]:
    """Yield a monitor with these parameters in a separate domain; active unless ``up`` is False.

    It keeps its history in memory unless a parameter names a folder, because all sources start at
    the same stamp. This stamp is long ago, so the history accepts tests of any stamp. Its health
    does not become stale on a busy machine.
    """
    # Fit them first: a health that is published before is published again.
    requirements_of(Calibration.builtin().unit_parameters, RequirementLimits())
    settings = {
        "history_folder": "memory",
        "history_max_offset_s": ANY_OFFSET_S,
        "expected_period_s": 1000.0,
        **(parameters or {}),
    }
    with (
        closing(Domain()) as domain,
        probed(MonitorNode, MonitorSession, settings, domain.number) as session,
    ):
        if up:
            session.bring_up()
        yield session
