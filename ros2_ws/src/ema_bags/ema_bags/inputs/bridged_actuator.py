# SPDX-License-Identifier: Apache-2.0
"""Telemetry, message rates and diagnostics of one bridged actuator."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

from ema_bags.inputs.bridging import LEAST_SAMPLES, Bridge
from ema_bags.inputs.defect_wording import defect_line
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_core.telemetry import Telemetry
from ema_ros.status import Task

SILENT_S: Final = 3.0
"""Time without messages after which a topic is silent [s]."""

_PUBLISHED: Final = "published [Hz]"
_CHECKED: Final = "checked [Hz]"
_REJECTED: Final = "rejected [Hz]"


class BridgeReception(NamedTuple):
    """State of the node and its topics."""

    state: str
    """Lifecycle state of the node."""
    missing: Mapping[str, str]
    """Reason why a topic cannot be subscribed to, keyed by topic."""
    has_source: Callable[[str], bool]
    """Function that returns whether a topic has a publisher."""


class BridgedActuator:
    """Collects the telemetry of one actuator and reports its status.

    Parameters
    ----------
    bridge
        Bridge that converts the actuator's messages to telemetry.
    hardware_id
        Namespace, name and serial number of the actuator.
    prefix
        Prefix of the diagnostic task names; "" if the node has a single actuator.
    step_s
        Interval between calls to `note` [s].
    silent_s
        Time without messages after which a topic is silent [s].

    Attributes
    ----------
    hardware_id
        Namespace, name and serial number of the actuator.
    problem
        Reason why the sample rate cannot be measured; empty if it can.
    """

    def __init__(
        self, bridge: Bridge, hardware_id: str, prefix: str, step_s: float, silent_s: float
    ) -> None:
        self.bridge = bridge
        self.problem = ""
        self.hardware_id = hardware_id
        self._prefix = f"{prefix} " if prefix else ""
        self._silent_s = silent_s
        # Message and sample counts: current values, and a history covering the last seconds.
        rates = (_PUBLISHED, _CHECKED, _REJECTED)
        self._counts = dict.fromkeys([*bridge.collector.topics, *rates], 0)
        times = round(silent_s / step_s) + 1
        self._past = deque([(time.monotonic(), self._counts.copy())], maxlen=times)

    def note(self) -> None:
        """Record the current message and sample counts, from which rates are computed."""
        self._past.append((time.monotonic(), self._counts.copy()))

    def count(self, topic: str) -> None:
        """Count a received message."""
        self._counts[topic] += 1

    def advance(self) -> list[Telemetry]:
        """Return blocks of telemetry completed since the previous call.

        Raises
        ------
        ValueError
            If the sample rate cannot be measured; ``problem`` holds the reason.
        """
        self._counts[_REJECTED] = self.bridge.collector.rejected
        try:
            blocks = self.bridge.advance()
        except ValueError as error:
            self.problem = (
                f"cannot measure the sample rate: {error}: set clock.source or clock.rate_hz in "
                "the mapping"
            )
            raise
        self.problem = ""
        self._counts[_PUBLISHED] += sum(map(len, blocks))
        self._counts[_CHECKED] = self.bridge.checked
        return blocks

    def tasks(self, reception: BridgeReception) -> list[Task]:
        """Return the diagnostic tasks for the input and the mapping."""
        return [self._input_task(reception), self._mapping_task()]

    def _recent(self) -> dict[str, float]:
        """Return recent message and sample rates by topic or counter [Hz]."""
        first_s, first = self._past[0]
        span_s = max(time.monotonic() - first_s, 1e-3)
        return {key: (count - first[key]) / span_s for key, count in self._counts.items()}

    def _input_task(self, reception: BridgeReception) -> Task:
        bridge, losses, rate = self.bridge, self.bridge.losses, self.bridge.rate
        recent = self._recent()
        values: dict[str, Any] = {
            "rate [Hz]": recent[self.bridge.mapping.position.topic],
            _PUBLISHED: recent[_PUBLISHED],
            "nominal rate [Hz]": 1.0 / rate.period if rate else 0.0,
            "jitter [us]": 1e6 * rate.jitter if rate else 0.0,
            "interpolated": bool(rate and not rate.is_regular),
            "samples": losses.samples,
            "lost": losses.lost,
            "gaps": losses.gaps,
            "filled": losses.filled,
            "pauses": losses.pauses,
            "clock jumps": losses.jumps,
            "repeated": losses.repeated,
            "not finite": losses.missing,
            "rebuilt stamps": bridge.rebuilt,
            "impossible": losses.impossible,
            "wraps": losses.wraps,
            "withheld": bridge.withheld,
        }
        level, message = self._input_level(reception, recent)
        return Task(f"{self._prefix}input", level, message, self.hardware_id, values)

    def _input_level(self, reception: BridgeReception, recent: dict[str, float]) -> tuple[int, str]:
        bridge, source = self.bridge, self.bridge.mapping.position.topic
        if reception.state != "active":
            return STALE, f"{reception.state}: the node receives no messages"
        if reception.missing:
            return ERROR, "; ".join(reception.missing.values())
        if waits := [topic for topic in bridge.collector.topics if not reception.has_source(topic)]:
            return WARN, f"no publisher on {', '.join(waits)}"
        is_long = len(self._past) == self._past.maxlen
        silent = self._silent(recent) if is_long else {}
        if source in silent:
            return STALE, silent[source]
        # Held commands, temperatures and payloads may be sent only on change; any other silent
        # source has failed.
        mapping = self.bridge.mapping
        slow = mapping.command, mapping.temperature, mapping.payload
        needed = {
            item.topic
            for _, _, item in mapping.wanted()
            if item not in slow or item.between != "hold"
        }
        reasons = [text for topic, text in silent.items() if topic in needed]
        reasons += [self.problem] * bool(self.problem)
        if recent[_REJECTED] or not bridge.losses.samples:
            reasons += filter(None, [bridge.collector.problem()])
        if bridge.rate is None and not reasons:
            expected = f"expected at least {LEAST_SAMPLES} in {bridge.settings.learn_s:g} s or more"
            return WARN, f"measuring the sample rate: {self._counts[source]} messages; {expected}"
        is_idle = is_long and not recent[_PUBLISHED]
        # The first messages after a silence cannot be published yet.
        middle = self._past[len(self._past) // 2][1]
        is_resumed = middle[source] == self._past[0][1][source]
        if bridge.refused or self.problem or (is_idle and not is_resumed):
            reason = "see mapping" if bridge.refused else "no complete samples"
            if not bridge.refused:
                reasons += [defect_line(item) for item in bridge.defects if item.is_error]
            text = f"{recent[source]:.4g} Hz received, but no telemetry is published"
            return ERROR, f"{text}: {'; '.join(reasons) or reason}"
        if bridge.rate and (hz := bridge.other_rate_hz):
            rates = f"{hz:.4g} Hz received, telemetry has {1.0 / bridge.rate.period:g} Hz"
            how = "a new rate is learned when the intervals between samples are even"
            reasons.append(f"{rates}: {how}")
        if reasons:
            return WARN, "; ".join(reasons)
        if is_idle:
            return STALE, f"{recent[source]:.4g} Hz received again, telemetry not yet published"
        rate = f"{1.0 / bridge.rate.period:g} Hz" if bridge.rate else ""
        return OK, "; ".join([rate, *(f"{text}; last value held" for text in silent.values())])

    def _silent(self, recent: dict[str, float]) -> dict[str, str]:
        """Return a message for each topic that has been silent for `silent_s`."""
        silent: dict[str, str] = {}
        for key, _, item in self.bridge.mapping.wanted():
            if not recent[item.topic]:
                prefix = f"nothing received on {item.topic} for {self._silent_s:g} s: "
                prefix = f"{silent[item.topic]}, " if item.topic in silent else prefix
                silent[item.topic] = f"{prefix}{key}"
        return silent

    def _mapping_task(self) -> Task:
        defects, errors = self.bridge.defects, self.bridge.refused
        values = {item.kind.value: defect_line(item) for item in defects}
        level, text = OK, "no defects found"
        if not self._recent()[_CHECKED]:
            level, text = STALE, "no samples to check"
        elif errors:
            level, text = ERROR, f"telemetry is withheld: {'; '.join(map(defect_line, errors))}"
        elif uncertain := self.bridge.uncertain:
            descriptions = "; ".join(map(defect_line, uncertain))
            level = WARN
            text = "possible errors, to be checked again after more motion; telemetry is not "
            text += f"withheld: {descriptions}"
        elif defects:
            asking = [
                item
                for item in defects
                if item.needs_action and item.kind not in self.bridge.mapping.accept
            ]
            level, text = WARN if asking else OK, "; ".join(map(defect_line, asking or defects))
        return Task(f"{self._prefix}mapping", level, text, self.hardware_id, values)
