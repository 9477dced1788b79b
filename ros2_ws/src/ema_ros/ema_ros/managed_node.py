# SPDX-License-Identifier: Apache-2.0
"""Lifecycle node that survives invalid requests and reports its status."""

import threading
import time
import traceback
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import Any, Final, cast

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.action.server import ActionServer
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle.publisher import LifecyclePublisher
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.timer import Timer

from ema_interfaces.msg import NodeStatus
from ema_ros import topics
from ema_ros.node_parameters import values_at_configure
from ema_ros.peers import Peers, incompatible_publishers, nodes_alive, nodes_in_touch
from ema_ros.rclpy_private import (
    lifecycle_state,
    parameter_overrides,
    release_state_machine,
    wrap_change_state,
)
from ema_ros.status import ERROR, OK, STALE, WARN, Task, status_message
from ema_ros.throttle import Throttle

_REPORT_S: Final = 1.0
_LOG_PERIOD_S: Final = 30.0
_SUCCESS: Final = TransitionCallbackReturn.SUCCESS
_AUTOSTART: Final = "autostart"
_AUTOSTART_DESCRIPTOR: Final = ParameterDescriptor(
    description="configure and activate at startup; false: a lifecycle manager does so",
    read_only=True,
)


class ManagedNode(LifecycleNode):
    """Lifecycle node that reports its status on ``/diagnostics`` and ``node_status``.

    Subclasses implement ``configure``, ``activate``, ``deactivate`` and ``clean_up``. Each may
    refuse with a ValueError or OSError, which is logged and published on ``/diagnostics``; the node
    then returns to the previous state. After any other exception, and after an exception in
    ``deactivate`` or ``clean_up``, the node releases all resources and is unconfigured. Entities
    created during activation are destroyed on deactivation, entities created during configuration
    on clean-up.

    Attributes
    ----------
    finished
        Event that is set when the node has finished and its process should end.
    exit_code
        Exit code of the process.
    stopping
        Event that is set when the process is about to end; blocking callbacks must return.
    is_interrupted
        Function that returns whether the process was asked to end, even before callbacks run.
    failed_callbacks
        Number of failed callbacks.
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        self.finished = threading.Event()
        self.stopping = threading.Event()
        self.exit_code = 0
        self.is_interrupted: Callable[[], bool] = lambda: False
        self.failed_callbacks = 0
        self._failures = Throttle(_LOG_PERIOD_S)
        self._refused = ""
        self._progress = ""
        self._configured = False
        # Values of the parameters that ``configure`` has read, and names of those changed since.
        self._values: dict[str, Any] = {}
        self._unused: list[str] = []
        # Entities not created by ``configure``, and entities created by ``activate``.
        self._kept: list[Any] = []
        self._kept_inactive: list[Any] = []
        self._peers = Peers(self.get_fully_qualified_name())
        self.declare_parameter(_AUTOSTART, True, _AUTOSTART_DESCRIPTOR)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._node_status = self.create_publisher(NodeStatus, topics.NODE_STATUS, topics.STATE)
        wrap_change_state(self, self._refuse_impossible)
        self.add_on_set_parameters_callback(self._refuse_clock_change)
        self.add_timer(_REPORT_S, self._report_regularly)

    def configure(self) -> None:
        """Read the parameters and create publishers, subscriptions and services."""

    def activate(self) -> None:
        """Start work."""

    def deactivate(self) -> None:
        """Stop work."""

    def clean_up(self) -> None:
        """Release the resources created by ``configure``."""

    def tasks(self) -> list[Task]:
        """Return the status of the node's tasks; called while it is configured."""
        return []

    def counts(self) -> NodeStatus:
        """Return the counts of the node; called while it is configured."""
        return NodeStatus()

    @property
    def hardware_id(self) -> str:
        """Hardware ID of the status; by default, the full name of the node."""
        return self.get_fully_qualified_name()

    @property
    def unit_namespace(self) -> str:
        """Namespace of the telemetry, which is part of a unit's name in all nodes."""
        return self.resolve_topic_name(topics.TELEMETRY).rpartition("/")[0]

    @property
    def is_configured(self) -> bool:
        """Whether the resources created by ``configure`` exist."""
        return self._configured

    @property
    def is_ending(self) -> bool:
        """Whether the process is about to end, so that long operations must return."""
        return self.stopping.is_set() or self.is_interrupted()

    @property
    def state(self) -> str:
        """Label of the lifecycle state."""
        return lifecycle_state(self)

    def bring_up(self) -> bool:
        """Configure and activate, unless a lifecycle manager does. Return False on failure."""
        self._log_unknown_parameters()
        if not self.get_parameter(_AUTOSTART).value:
            self.get_logger().info("unconfigured: waiting for a lifecycle manager")
            return True
        return self.trigger_configure() == _SUCCESS and self.trigger_activate() == _SUCCESS

    def destroy_node(self) -> None:
        """Destroy the node and its state machine."""
        super().destroy_node()
        release_state_machine(self)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[..., Any], **kwargs: Any
    ) -> Any:
        """Create a service that responds to every request, with the reason on failure.

        Parameters are as in ``rclpy.node.Node.create_service``. An exception of the callback
        becomes ``message`` of a response without success; the text of a ValueError is used
        unchanged.
        """

        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                if not hasattr(response, "message"):
                    raise  # a service of rclpy itself
                reason = str(error)
                if not isinstance(error, ValueError | OSError):
                    reason = f"failed: {error!r}"
                    self.get_logger().error(f"{srv_name} {reason}\n{traceback.format_exc()}")
                return srv_type.Response(message=reason)

        kwargs = {"qos_profile": topics.SERVICE, **kwargs}
        return super().create_service(srv_type, srv_name, answer, **kwargs)

    def add_timer(self, period_s: float, callback: Callable[[], object]) -> Timer:
        """Create a timer that also runs while simulated time is paused."""
        return self.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def add_publisher(
        self, message_class: Any, topic: str, qos: QoSProfile, *, quiet: bool = False
    ) -> LifecyclePublisher:
        """Create a publisher that publishes while the node is active.

        A quiet publisher does not report subscriptions with an incompatible quality of service;
        with many publishers, these events are slow.
        """
        events = PublisherEventCallbacks(use_default_callbacks=not quiet)
        publisher = cast(
            LifecyclePublisher,
            self.create_lifecycle_publisher(message_class, topic, qos, event_callbacks=events),
        )
        if self.state == "active":
            publisher.on_activate(LifecycleState(label=self.state, state_id=0))
        return publisher

    def full_topic_names(self, names: Sequence[str]) -> set[str] | None:
        """Return the full names of ``names``, the parameter ``topics``; None if it is empty.

        Raises
        ------
        ValueError
            If a name is not a valid topic name.
        """
        try:
            return {self.resolve_topic_name(name) for name in names} or None
        except RuntimeError as error:
            raise ValueError(f"parameter topics = {list(names)!r}: {error}") from error

    def report_progress(self, text: str) -> None:
        """Report the progress of the current transition in log and status."""
        self._progress = text
        self.get_logger().info(text)
        self.report([self._lifecycle_task()])

    def log_failure(self, error: Exception) -> None:
        """Count a failed callback, and log it; similar failures are logged once per 30 s."""
        if isinstance(error, InvalidHandle):
            return  # the served entity has just been destroyed
        self.failed_callbacks += 1
        location = traceback.extract_tb(error.__traceback__)[-1:]
        kind = f"a callback failed: {error!r} {location}"
        passed = self._failures.passed(kind, time.monotonic())
        if passed is not None:
            trace = "".join(traceback.format_exception(error))
            held_back = passed.removeprefix(kind)
            self.get_logger().error(f"a callback failed{held_back}:\n{trace}")

    def report_end(self, failure: str, trace: str) -> None:
        """Report that a thread has ended unexpectedly, with the traceback."""
        self.get_logger().error(f"{failure}\n{trace}")
        self.report()

    def report(self, tasks: Sequence[Task] = ()) -> None:
        """Publish the status of ``tasks``. Thread-safe.

        If ``tasks`` is empty, publish the status of the lifecycle, the peers and all tasks of the
        node, and its counts. While the node is not active, the status of its tasks is STALE instead
        of OK; the status of the lifecycle is not changed.
        """
        node_tasks = [] if tasks else [self._lifecycle_task()]
        counts = None
        if not tasks:
            counts = self.counts() if self._configured else NodeStatus()
            peers = self._peers.task(self.hardware_id, time.monotonic())
            tasks = [peers, *(self.tasks() if self._configured else [])]
        state = self.state
        tasks = node_tasks + [
            replace(task, level=STALE, message=f"{state}: {task.message}", category="")
            if task.level == OK and state != "active"
            else task
            for task in tasks
        ]
        name = self.get_fully_qualified_name()
        message = DiagnosticArray(status=[status_message(name, task) for task in tasks])
        now = self.get_clock().now()
        # Simulated time is 0 until /clock is received.
        message.header.stamp = (now if now.nanoseconds else Clock().now()).to_msg()
        self._diagnostics.publish(message)
        if counts is not None:
            counts.header.stamp, counts.node = message.header.stamp, name
            self._node_status.publish(counts)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; the node remains unconfigured if ``configure`` refuses."""
        self._kept = entities_of(self)
        result = self._attempt("configure", self.configure)
        self._configured = result == _SUCCESS
        if result == _SUCCESS:
            self._values = values_at_configure(self)
            return self._done("configured", super().on_configure(state))
        if result == TransitionCallbackReturn.FAILURE:
            destroy_entities(self, self._kept)
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate; the node remains inactive if ``activate`` refuses."""
        self._kept_inactive = entities_of(self)
        super().on_activate(state)
        result = self._attempt("activate", self.activate)
        if result == _SUCCESS:
            values = values_at_configure(self)
            self._unused = [name for name in values if values[name] != self._values.get(name)]
            if self._unused:
                self.get_logger().warning(self._unused_parameters)
            return self._done("active", result)
        if result == TransitionCallbackReturn.FAILURE:
            super().on_deactivate(state)
            destroy_entities(self, self._kept_inactive)
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate: stop receiving first, while the publishers still publish."""
        return self._done("inactive", self._end_activity(state))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the resources of the configuration."""
        return self._done("unconfigured", self._end_configuration(state))

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop all activity, and then end the process, whoever requests the transition."""
        steps = []
        if state.label == "active":
            steps.append(self._end_activity(state))
        if state.label in ("active", "inactive"):
            steps.append(self._end_configuration(state))
        # Set last, because the process waits only briefly for the transition to return.
        self.finished.set()
        if any(step != _SUCCESS for step in steps):
            return TransitionCallbackReturn.ERROR
        return self._done("finalized", super().on_shutdown(state))

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release all remaining resources after a failed transition and become unconfigured."""
        self._configured = False
        # Only the first reason is reported: later steps fail because an earlier step failed.
        for step in (self.deactivate, self.clean_up):
            try:
                step()
            except Exception as error:
                self.get_logger().debug(f"after an error: {error!r}")
        super().on_deactivate(state)
        destroy_entities(self, self._kept)
        return self._done("unconfigured after an error", _SUCCESS)

    def _end_activity(self, state: LifecycleState) -> TransitionCallbackReturn:
        for timer in set(self.timers) - set(self._kept_inactive):
            self.destroy_timer(timer)
        for subscription in set(self.subscriptions) - set(self._kept_inactive):
            self.destroy_subscription(subscription)
        result = self._attempt("deactivate", self.deactivate)
        super().on_deactivate(state)
        return result if result == _SUCCESS else TransitionCallbackReturn.ERROR

    def _end_configuration(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._configured = False
        result = self._attempt("clean up", self.clean_up)
        if result != _SUCCESS:
            return TransitionCallbackReturn.ERROR
        destroy_entities(self, self._kept)
        return super().on_cleanup(state)

    def _attempt(self, name: str, step: Callable[[], None]) -> TransitionCallbackReturn:
        """Run a lifecycle step and report its errors, which rclpy does not do."""
        try:
            step()
        except (ValueError, OSError) as error:
            self._refused = f"cannot {name}: {error}"
            self.get_logger().error(self._refused)
            return TransitionCallbackReturn.FAILURE
        except Exception as error:
            self._refused = f"cannot {name}: {error!r}"
            self.get_logger().error(f"{self._refused}\n{traceback.format_exc()}")
            return TransitionCallbackReturn.ERROR
        finally:
            self._progress = ""
        self._refused = ""
        return _SUCCESS

    def _done(self, state: str, result: TransitionCallbackReturn) -> TransitionCallbackReturn:
        if result == _SUCCESS:
            self.get_logger().info(state)
        return result

    def _lifecycle_task(self) -> Task:
        values = {"failed callbacks": self.failed_callbacks}
        if self._refused:
            message = f"{self.state}: {self._refused}"
            return Task("lifecycle", ERROR, message, self.hardware_id, values)
        is_active = self.state == "active"
        level = OK if is_active and not self._unused else WARN
        remark = self._unused_parameters if is_active else ""
        message = ": ".join(filter(None, (self.state, self._progress or remark)))
        return Task("lifecycle", level, message, self.hardware_id, values)

    @property
    def _unused_parameters(self) -> str:
        """Sentence about parameters that were changed between configure and activate, or ""."""
        if not self._unused:
            return ""
        verb = "has" if len(self._unused) == 1 else "have"
        return (
            f"{', '.join(self._unused)} {verb} changed since the node was configured, without "
            "effect: deactivate, clean up, configure and activate"
        )

    def _report_regularly(self) -> None:
        now_s = time.monotonic()
        in_touch, before = nodes_in_touch(self), self._peers.collision
        for lost in self._peers.update(in_touch, nodes_alive(self), now_s):
            self.get_logger().warning(f"{lost} has disappeared from the graph")
        if self._peers.collision and not before:
            self.get_logger().error(self._peers.collision)
        self._peers.incompatible = incompatible_publishers(self)
        self.report()

    def _log_unknown_parameters(self) -> None:
        """Log undeclared parameters, which rclpy does not report."""
        declared = self.list_parameters([], 0).names
        for name in parameter_overrides(self):
            if name in declared:
                continue
            text = f"parameter {name} is not declared by this node and has no effect"
            if similar := get_close_matches(name, declared, 1, 0.85):
                self.get_logger().warning(f"{text}: did you mean {similar[0]}?")
            else:
                self.get_logger().info(text)

    def _refuse_impossible(self, change_state: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap the ``change_state`` callback to refuse impossible transitions."""

        def change_if_possible(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except RuntimeError:
                transition = request.transition.label or request.transition.id
                self.get_logger().warning(
                    f"transition {transition!r} is not possible in state {self.state!r}"
                )
                response.success = False
                return response

        return change_if_possible

    def _refuse_clock_change(self, parameters: list[Parameter]) -> SetParametersResult:
        """Refuse to change the clock while the node is configured, as its entities use it."""
        if self._configured and any(item.name == "use_sim_time" for item in parameters):
            reason = "use_sim_time can only be changed while the node is unconfigured"
            return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)


def entities_of(node: LifecycleNode) -> list[Any]:
    """Return all entities of a node: publishers, subscriptions, services, timers, actions etc."""
    return [item for items in _by_destroyer(node).values() for item in items]


def destroy_entities(node: LifecycleNode, kept: Collection[Any]) -> None:
    """Destroy all entities of a node except ``kept``; actions first, as they own services."""
    kept_ids = {id(item) for item in kept}
    for destroy in _by_destroyer(node):
        for item in list(_by_destroyer(node)[destroy]):
            if id(item) not in kept_ids:
                destroy(item)


def _by_destroyer(node: LifecycleNode) -> dict[Callable[[Any], Any], list[Any]]:
    """Return the entities of a node grouped by destroy method."""
    published = list(node.publishers)
    managed = [item for item in published if isinstance(item, LifecyclePublisher)]
    return {
        ActionServer.destroy: [item for item in node.waitables if isinstance(item, ActionServer)],
        node.destroy_lifecycle_publisher: managed,
        node.destroy_publisher: [item for item in published if item not in managed],
        node.destroy_subscription: list(node.subscriptions),
        node.destroy_service: list(node.services),
        node.destroy_client: list(node.clients),
        node.destroy_timer: list(node.timers),
        node.destroy_guard_condition: list(node.guards),
    }
