"""A graph of node processes in a domain of its own, with an observer beside them."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ema_cli.processes.bringup import assignments_of, program
from ema_cli.processes.domains import Domain
from ema_core.linear_algebra import one_thread
from ema_interfaces.msg import FaultEstimate, TelemetryBlock
from ema_ros.stamps import stamp_from_message
from ema_ros.topics import FAULT_ESTIMATE, NAMESPACE, STREAM, TELEMETRY

DEADLINE_S: Final = 60.0
"""How long what has to happen is waited for [s]; nothing takes a tenth of this when it is idle."""

_PROFILE: Final = Path(__file__).resolve().parents[2] / "tools" / "fastdds.xml"


class GraphError(Exception):
    """What had to happen in a graph has not."""


@dataclass(frozen=True)
class Status:
    """The latest status of a task; ``came_s`` is when it came [s]."""

    level: int
    message: str
    values: dict[str, str]
    came_s: float


@dataclass(frozen=True)
class Estimate:
    """An estimate that was received at a time [s]."""

    actuator_id: str
    window: int
    end_ns: int
    valid: bool
    reason: str
    came_s: float


class Graph:
    """Starts nodes as processes, stops, kills and pauses them, and listens to what they say.

    Attributes
    ----------
    processes
        Those that were started and not ended, by name.
    began_s
        When each was started last, of the machine's clock [s].
    estimates
        All estimates so far.
    status
        Latest status by its name.
    told
        All messages that differ of each status, in their order.
    blocks
        When each block of telemetry was sent [ns], and received [s].
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.began_s: dict[str, float] = {}
        self.estimates: list[Estimate] = []
        self.status: dict[str, Status] = {}
        self.told: dict[str, list[str]] = {}
        self.blocks: list[tuple[int, float]] = []
        self._started = 0
        self._ending = threading.Event()
        self._open = ExitStack()

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as opened:
            self._domain = opened.enter_context(closing(Domain()))
            context = Context()
            context.init(domain_id=self._domain.number)
            opened.callback(context.try_shutdown)
            node = self.node = Node("observer", namespace="/campaign", context=context)
            opened.callback(node.destroy_node)
            node.create_subscription(
                FaultEstimate, f"{NAMESPACE}/{FAULT_ESTIMATE}", self._note_estimate, STREAM
            )
            node.create_subscription(DiagnosticArray, "/diagnostics", self._note_status, STREAM)
            # Typed as rclpy has it: with two arguments it is given what is known of the message.
            note_block: Any = self._note_block
            node.create_subscription(
                TelemetryBlock, f"{NAMESPACE}/{TELEMETRY}", note_block, STREAM, raw=True
            )
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(node)
            opened.callback(executor.shutdown)
            thread = threading.Thread(target=self._spin, args=(executor,), name="observer")
            thread.start()
            opened.callback(thread.join)
            opened.callback(self._ending.set)
            self._open = opened.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes.values():
            process.kill()
            process.wait()
        self._open.close()

    def start(
        self, name: str, node: str = "", remaps: Sequence[str] = (), **parameters: Any
    ) -> None:
        """Start a node."""
        given = {key.replace("__", "."): value for key, value in parameters.items()}
        words = [word for item in assignments_of(given) for word in ("-p", item)]
        words += [word for item in remaps for word in ("-r", item)]
        self._started += 1
        self.began_s[name] = time.time()
        with (self.folder / f"{self._started:03d}_{name}.log").open("wb") as log:
            self.processes[name] = subprocess.Popen(
                [program(node or name), "--ros-args", *words],
                stdout=log,
                stderr=log,
                env=os.environ
                | {
                    "ROS_DOMAIN_ID": str(self._domain.number),
                    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
                    "ROS_HOME": str(self.folder / "ros_home"),
                    "FASTRTPS_DEFAULT_PROFILES_FILE": str(_PROFILE),
                }
                | one_thread(),
                pass_fds=[self._domain.descriptor],
            )

    def kill(self, name: str) -> float:
        """Kill a node with signal 9; return when that was done, of the machine's clock [s]."""
        process = self.processes.pop(name)
        process.kill()
        process.wait()
        return time.time()

    def stop(self, name: str) -> int:
        """Ask a node to end; return its exit code."""
        process = self.processes.pop(name)
        process.send_signal(signal.SIGINT)
        try:
            return process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired as error:
            process.kill()
            process.wait()
            raise GraphError(f"{name} did not end within {DEADLINE_S:g} s") from error

    def pause(self, name: str) -> None:
        """Let a node stand still, without its knowledge."""
        self.processes[name].send_signal(signal.SIGSTOP)

    def resume(self, name: str) -> None:
        """Let a node go on that stands still."""
        self.processes[name].send_signal(signal.SIGCONT)

    def wait_for(
        self, condition: Callable[[], Any], what: str, deadline_s: float = DEADLINE_S
    ) -> Any:
        """Wait until a condition holds, and return what it returned.

        Raises
        ------
        GraphError
            If it does not hold in time, or a node ends by itself.
        """
        end_s = time.monotonic() + deadline_s
        while not (result := condition()):
            self.check_alive()
            if time.monotonic() > end_s:
                raise GraphError(f"not within {deadline_s:g} s: {what}")
            self._ending.wait(0.02)
        return result

    def wait(self, seconds: float) -> None:
        """Let time go by [s], while all nodes have to live."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            self.check_alive()
            self._ending.wait(min(left_s, 0.1))

    def check_alive(self) -> None:
        """Raise GraphError when a node has ended by itself."""
        for name, process in self.processes.items():
            if (code := process.poll()) is not None:
                raise GraphError(f"{name} has ended by itself with code {code}")

    def says(self, status: str, text: str, since_s: float = 0.0) -> bool:
        """Return whether a status has a text in its message and came after a time [s]."""
        found = self.status.get(status)
        return found is not None and found.came_s > since_s and text in found.message

    def valid_since(self, since_s: float) -> list[Estimate]:
        """Return the valid estimates that came after a time [s]."""
        return [item for item in self.estimates if item.valid and item.came_s > since_s]

    def failures(self) -> list[str]:
        """Return the first lines of tracebacks in the logs."""
        return [
            f"{path.name}: {text.strip().splitlines()[-1]}"
            for path in sorted(self.folder.glob("*.log"))
            if "Traceback" in (text := path.read_text(errors="replace"))
        ]

    def _spin(self, executor: SingleThreadedExecutor) -> None:
        while not self._ending.is_set():
            # What is destroyed while the executor looks at it raises, and is of no concern.
            with suppress(InvalidHandle):
                executor.spin_once(timeout_sec=0.1)

    def _note_estimate(self, message: FaultEstimate) -> None:
        self.estimates.append(
            Estimate(
                message.actuator_id,
                message.window,
                stamp_from_message(message.window_end),
                message.valid,
                message.reason,
                time.time(),
            )
        )

    def _note_status(self, message: DiagnosticArray) -> None:
        now_s = time.time()
        for item in message.status:
            values = {pair.key: pair.value for pair in item.values}
            self.status[item.name] = Status(item.level[0], item.message, values, now_s)
            told = self.told.setdefault(item.name, [])
            if not told or told[-1] != item.message:
                told.append(item.message)

    def _note_block(self, _: bytes, information: Any) -> None:
        self.blocks.append(
            (information["source_timestamp"], information["received_timestamp"] * 1e-9)
        )
