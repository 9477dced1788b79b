# SPDX-License-Identifier: Apache-2.0
"""Base class of nodes that simulate a machine in real time or at another rate."""

from typing import Any, Final

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from ema_ros.managed_node import ManagedNode
from ema_ros.stamps import stamp_to_message
from ema_ros.status import ERROR, OK, WARN, Task
from ema_sim.runner import Bench, BenchRunner, SimulationPace

CLOCK: Final = "/clock"

_CLOCK_QOS: Final = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class SimulationNode(ManagedNode):
    """Lifecycle node that publishes a simulation and reports its lag behind the schedule.

    Subclasses implement ``publish_cycle`` and ``publish_block``.
    """

    def run_bench(
        self, bench: Bench[Any], rate: float, offers: dict[str, tuple[Any, QoSProfile]]
    ) -> None:
        """Create the publishers, and the runner of the simulation, which ``activate`` starts.

        Parameters
        ----------
        bench
            The simulation.
        rate
            Ratio of simulated to wall time [-]; ``/clock`` is published unless it is 1.
        offers
            Message class and quality of service, keyed by topic.
        """
        self._rate = rate
        self._reported_behind = False
        self._runner: BenchRunner[Any, Any] = BenchRunner(
            bench,
            rate,
            on_cycle=self.publish_cycle,
            on_block=self.publish_block,
            on_failure=self.report_end,
        )
        if rate != 1.0:
            offers = {**offers, CLOCK: (Clock, _CLOCK_QOS)}
        self._publishers_by_topic = {
            name: self.add_publisher(message, name, qos) for name, (message, qos) in offers.items()
        }

    def publish_cycle(self, cycle: Any) -> None:
        """Publish the start of a cycle."""

    def publish_block(self, block: Any) -> None:
        """Publish a block of samples."""

    def activate(self) -> None:
        """Start the thread that runs cycles."""
        self._reported_behind = False
        self._runner.start()

    def deactivate(self) -> None:
        """Stop the simulation before its next block."""
        self._runner.stop()

    def tasks(self) -> list[Task]:
        """Return the status of the simulation: rate, lag and failures of its thread."""
        runner, pace = self._runner, self._runner.pace
        values = {
            "cycle": runner.cycle,
            "rate": self._rate,
            "achieved rate": pace.achieved_rate,
            "lag [s]": pace.lag_s,
            "busy share": pace.busy_share,
            "ends of threads": runner.thread.ends,
        }
        if failure := runner.thread.failure:
            return [Task("simulation", ERROR, failure, self.hardware_id, values)]
        if pace.behind and runner.activity == "running":
            return [Task("simulation", WARN, self._lag_message(pace), self.hardware_id, values)]
        level = OK if runner.activity == "running" else WARN
        return [Task("simulation", level, runner.activity, self.hardware_id, values)]

    def publish(self, topic: str, message: Any) -> None:
        """Publish a message on one of the topics passed to ``run_bench``, or on ``/clock``."""
        self._publishers_by_topic[topic].publish(message)

    def publish_clock(self, stamp_ns: int) -> None:
        """Publish simulated time [ns], unless the simulation runs in real time."""
        if CLOCK in self._publishers_by_topic:
            self.publish(CLOCK, Clock(clock=stamp_to_message(stamp_ns)))

    def report_pace(self) -> None:
        """Log when the simulation falls behind, and when it has caught up."""
        pace = self._runner.pace
        if pace.behind == self._reported_behind:
            return
        self._reported_behind = pace.behind
        if pace.behind:
            self.get_logger().warning(self._lag_message(pace))
        else:
            self.get_logger().info(f"keeps up again at rate {self._rate:g}")
        self.report()

    def _lag_message(self, pace: SimulationPace) -> str:
        return (
            f"cannot keep up: lag {pace.lag_s:.3g} s, rate {pace.achieved_rate:.3g} instead of "
            f"{self._rate:g}"
        )
