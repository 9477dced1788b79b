# SPDX-License-Identifier: Apache-2.0
"""Nodes that are killed or paused at random times: lost data, and recovery of the graph.

All nodes but the actuator are killed in turn, and one is paused for 10 s. After each kill, the data
recorded and stored before it exists, the node works again after a restart, and the other nodes
report which node is missing.
"""

import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from ema_monitor.prognosis.history import history_path
from ema_ros.stamps import stamp_from_message

from ..ros.graph import Graph
from .case import Case
from .kill_losses import MOST_LOST_S, TELEMETRY, check_bag, check_history, measure_loss

_LIVE_KILLS: Final = 8
_PLAYER_KILLS: Final = 2
_STANDSTILL_S: Final = 10.0
_LIVE: Final = ("recorder", "monitor", "dashboard")
_SHARES: Final = (0.4, 0.4, 0.2)
_UNIT: Final = ("flap", "SIM-0001")
_GONE_WITHIN_S: Final = 20.0
_LONGEST_WAIT_S: Final = 3.0
"""Longest life of a node before it is killed [s]: two test cycles."""


class NodeKills:
    """A graph whose nodes are killed and paused."""

    def __init__(self, case: Case) -> None:
        self._case = case
        self._rng = case.rng()
        self._folder = case.folder
        self._bags: list[Path] = []
        self._lost_tests: set[int] = set()
        self._recording_s: float | None = None  # time since which the recorder certainly records

    def run(self) -> None:
        """Kill and check the nodes. Record a failure that ends the case with its reason."""
        for what, step in (("live", self._live), ("replay", self._replay)):
            with Graph(self._folder / what) as graph:
                try:
                    step(graph)
                except (AssertionError, OSError, ValueError) as error:
                    self._case.fail(f"{what}: {error}")
                    return
                finally:
                    for failure in graph.failures():
                        self._case.fail(failure)

    def _live(self, graph: Graph) -> None:
        graph.start("actuator", seed=int(self._rng.integers(1000)))
        for name in ("monitor", "recorder", "dashboard"):
            self._begin(graph, name)
        graph.wait_for(lambda: graph.valid_since(0.0), "the first valid estimate")
        for kill in range(_LIVE_KILLS):
            victim = str(self._rng.choice(_LIVE, p=_SHARES))
            early = self._rng.random() < 0.1
            # Occasionally during its start, otherwise at any time of its life.
            if not early:
                self._wait_until_back(graph, victim)
            graph.wait(self._rng.uniform(0.0, _LONGEST_WAIT_S))
            self._kill(graph, victim, waits=kill % 2 == 0 and not early)
        for name in ("monitor", "recorder", "dashboard"):
            self._wait_until_back(graph, name)
        self._stand_still(graph)
        for name in ("dashboard", "monitor", "recorder", "actuator"):
            if (code := graph.stop(name)) != 0:
                self._case.fail(f"{name} ended with code {code} when it was asked to end")
        check_bag(self._case, self._bags[-1], is_closed=True)

    def _begin(self, graph: Graph, name: str) -> None:
        if name == "recorder":
            self._recording_s = None
            self._bags.append(self._folder / f"bag_{len(self._bags)}")
            graph.start(name, output=self._bags[-1])
        elif name == "monitor":
            graph.start(name, history_folder=self._folder / "history")
        else:
            graph.start(name, port=0)

    def _wait_until_back(self, graph: Graph, name: str, since_s: float = 0.0) -> None:
        """Wait until a node works after its last start."""
        began_s = max(graph.began_s[name], since_s)
        works: dict[str, Callable[[], Any]] = {
            "monitor": lambda: graph.valid_since(began_s),
            "dashboard": lambda: self._serves(graph, began_s),
            "recorder": lambda: self._records(graph, began_s),
        }
        graph.wait_for(works[name], f"{name} to work again")
        if name == "recorder" and self._recording_s is None:
            self._recording_s = time.time()

    def _records(self, graph: Graph, since_s: float) -> bool:
        status = graph.status.get("/ema/recorder: recording")
        return (
            status is not None
            and status.came_s > since_s
            and status.values.get("bag") == str(self._bags[-1])
            and TELEMETRY in status.values.get("topics", "")
            and int(status.values.get("messages", "0")) > 0
        )

    def _serves(self, graph: Graph, since_s: float) -> bool:
        status = graph.status.get("/ema/dashboard: dashboard")
        if status is None or status.came_s < since_s:
            return False
        try:
            with urllib.request.urlopen(status.values["address"], timeout=5.0) as answer:
                return answer.status == 200
        except (urllib.error.URLError, OSError):
            return False

    def _kill(self, graph: Graph, victim: str, *, waits: bool) -> None:
        observers = in_touch(graph, victim)
        killed_s = graph.kill(victim)
        if victim == "recorder":
            recorded_s = 0.0 if self._recording_s is None else killed_s - self._recording_s
            is_due = recorded_s > MOST_LOST_S
            check_bag(self._case, self._bags[-1], is_closed=False, is_due=is_due)
            measure_loss(self._case, self._bags[-1], graph, killed_s, is_due=is_due)
        if victim == "monitor":
            path = history_path(self._folder / "history", *_UNIT)
            ends = {stamp_from_message(estimate.window_end) for estimate in graph.valid_since(0.0)}
            answered = sorted(ends)
            self._lost_tests |= check_history(self._case, path, _UNIT, answered, self._lost_tests)
        if waits:
            self._wait_until_reported(graph, victim, observers, killed_s)
        graph.check_alive()
        self._begin(graph, victim)

    def _wait_until_reported(
        self, graph: Graph, victim: str, observers: list[str], since_s: float
    ) -> None:
        for name in observers:
            graph.wait_for(
                lambda name=name: graph.reports(f"/ema/{name}: peers", f"/ema/{victim}", since_s),
                f"{name} to say that {victim} has gone",
                _GONE_WITHIN_S,
            )

    def _stand_still(self, graph: Graph) -> None:
        victim = str(self._rng.choice(_LIVE))
        observers = in_touch(graph, victim)
        graph.pause(victim)
        try:
            graph.wait(_STANDSTILL_S)
        finally:
            graph.resume(victim)
        for name in observers:
            if not any(f"/ema/{victim}" in text for text in graph.reported[f"/ema/{name}: peers"]):
                self._case.fail(f"{name} did not say that {victim} had gone for a while")
        since_s = time.time()
        self._wait_until_back(graph, victim, since_s)
        graph.wait_for(
            lambda: set(observers) <= set(in_touch(graph, victim, since_s)),
            f"all to be in touch again with {victim}",
        )

    def _replay(self, graph: Graph) -> None:
        """Play the last bag into a monitor in simulated time, and kill the player."""
        bag = str(self._bags[-1])
        graph.start("monitor", use_sim_time=True)
        graph.wait_for(lambda: graph.reports("/ema/monitor: lifecycle", "active"), "the monitor")
        for _ in range(_PLAYER_KILLS):
            self._play(graph, bag)
            graph.wait(self._rng.uniform(0.0, _LONGEST_WAIT_S))
            observers = in_touch(graph, "player")
            killed_s = graph.kill("player")
            self._wait_until_reported(graph, "player", observers, killed_s)
        self._play(graph, bag)
        for name in ("player", "monitor"):
            if (code := graph.stop(name)) != 0:
                self._case.fail(f"{name} ended with code {code} when it was asked to end")

    def _play(self, graph: Graph, bag: str) -> None:
        began_s = time.time()
        graph.start("player", bag=bag, actuator_only=True, loop=True)
        graph.wait_for(lambda: graph.valid_since(began_s), "a valid estimate of what is played")


def in_touch(graph: Graph, victim: str, since_s: float = 0.0) -> list[str]:
    """Return the nodes whose status, after a time [s], lists another node as present."""
    statuses = {name: graph.status.get(f"/ema/{name}: peers") for name in graph.processes}
    return [
        name
        for name, status in statuses.items()
        if status is not None
        and status.came_s > max(since_s, graph.began_s[name])
        and f"/ema/{victim}" in status.values["present"].split(", ")
    ]
