# SPDX-License-Identifier: Apache-2.0
"""Learned baselines of the units of a monitor that have an unknown drive."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from ema_core.description import ActuatorDescription, UnitKey
from ema_core.wording import counted
from ema_monitor.baselines.changes import BaselineChange, ChangeKind
from ema_monitor.baselines.unit_baseline import InUseError, UnitBaseline
from ema_monitor.calibrations import CalibrationStore
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.identification.joint_estimate import learning_estimate
from ema_monitor.joint.learning import unusable
from ema_monitor.node.publish.actuators import Actuators
from ema_monitor.node.publish.log import Log
from ema_monitor.node.publish.messages import baseline_to_message
from ema_monitor.node.publish.outputs import Outputs
from ema_monitor.node.settings import Operation
from ema_monitor.reason_texts import text_of
from ema_monitor.reasons import BaselineUnusable, EffortMissing, Reason
from ema_monitor.windows.finder import Segment
from ema_monitor.windows.window import Window
from ema_ros.node_parameters import LiveSettings

_AUTOMATIC: Final = "accept_after = {}"


class Baselines:
    """Learns, accepts and changes the baselines of units with an unknown drive. Thread-safe.

    Parameters
    ----------
    folder
        Folder of the baselines; None if no baselines are learned.
    operation
        Limits, timeouts and conditions of automatic acceptance.
    store
        Calibrations in use, to which accepted baselines are added.
    actuators, outputs
        Status of the actuators, and publishers of the progress.
    alarm
        Returns the cause of a unit's WARN or ERROR; empty at other levels.
    announce
        Called with a unit, the change of its baseline, and whether a person forced it.
    log
        Log of the node.
    """

    def __init__(
        self,
        folder: Path | None,
        operation: LiveSettings[Operation],
        store: CalibrationStore,
        actuators: Actuators,
        outputs: Outputs,
        alarm: Callable[[ActuatorDescription], str],
        announce: Callable[[ActuatorDescription, BaselineChange, bool], None],
        log: Log,
    ) -> None:
        self._folder = folder
        self._operation = operation
        self._store = store
        self._actuators = actuators
        self._outputs = outputs
        self._alarm = alarm
        self._announce = announce
        self._log = log
        self._lock = threading.RLock()
        self._open: dict[UnitKey, UnitBaseline] = {}
        # Units whose records were fitted after their number sufficed for automatic acceptance.
        self._enough: set[UnitKey] = set()

    def learns(self, description: ActuatorDescription) -> bool:
        """Return whether the baseline of a unit is learned."""
        return self._folder is not None and not description.is_modelled

    def resume(self, description: ActuatorDescription) -> None:
        """Publish the progress of a newly described unit, if its baseline is learned."""
        if not self.learns(description):
            return
        if (reason := _unlearnable(description)) is not None:
            self._actuators.show_learning(description, text_of(reason), is_learning=False)
            return
        with self._lock:
            try:
                baseline = self._of(description)
                if baseline.damage:
                    raise ValueError(baseline.damage)
                if baseline.is_fit_due:
                    baseline.fit()
            except (OSError, ValueError) as error:
                self._log.warn(description.actuator_id, _unusable_text(error), is_first=True)
                self._actuators.show_learning(description, _unusable_text(error))
                return
            text = self._publish(baseline, baseline.latest_ns)
        self._actuators.show_learning(description, text)

    def learn(self, segment: Segment) -> Estimate | None:
        """Add a record to the baseline of its unit, if the unit is learning.

        Returns the estimate, which gives no level; None if the record must be compared with a
        calibration instead.
        """
        description, window = segment.description, segment.window
        if not self.learns(description):
            return None
        if (missing := _unlearnable(description)) is not None:
            return learning_estimate(window, missing)
        change = None
        with self._lock:
            try:
                baseline = self._of(description)
                if baseline.is_accepted:
                    return None
                reason: Reason | None
                if not isinstance(window, Window):
                    reason = window.cause
                elif (reason := unusable(window.telemetry, description)) is None:
                    baseline.add(window)
                    change = self._fit(baseline)
            except (OSError, ValueError) as error:
                return learning_estimate(window, _unusable(error))
            progress = baseline.progress(self._operation.value.accept_after).as_reason
            self._publish(baseline, window.end_ns)
        if change is not None:
            self._announce(description, change, False)
            words = f"accepted by {change.author}: the next record gives the level"
            return learning_estimate(window, replace(progress, detail=words))
        return learning_estimate(window, *filter(None, (progress, reason)))

    def note(self, diagnosed: Diagnosed, window: Window) -> None:
        """Store a record as a candidate to extend the accepted baseline.

        Records without a valid estimate, with a departure or with a doubtful comparison are
        ignored.
        """
        description, estimate = diagnosed.description, diagnosed.estimate
        comparison = estimate.comparison
        if not self.learns(description) or estimate.verdict != Verdict.VALID or comparison is None:
            return
        if comparison.has_departed or comparison.doubtful:
            return
        with self._lock:
            try:
                self._of(description).add(window)
            except (OSError, ValueError) as error:
                self._log.warn(description.actuator_id, _unusable_text(error))

    def change(
        self,
        description: ActuatorDescription,
        kind: ChangeKind,
        person: str,
        note: str,
        *,
        force: bool,
    ) -> str:
        """Change the baseline of a unit on a person's request. Return the result as a sentence.

        Raises
        ------
        ValueError
            If the change is refused; the message names the reason.
        """
        if not self.learns(description):
            why = (
                "the parameter baseline_folder is empty"
                if self._folder is None
                else f"its drive is {description.drive}: use ~/calibrate"
            )
            raise ValueError(f"the baseline of {description.actuator_id!r} is not learned: {why}")
        with self._lock:
            try:
                baseline = self._of(description)
                if not force and (reason := self._doubt(baseline, kind)):
                    raise ValueError(f"{reason}: repair it first, or set force")
                if kind is ChangeKind.ACCEPT:
                    change = baseline.accept(person, note, force=force)
                elif kind is ChangeKind.EXTEND:
                    change = baseline.extend(person, note, force=force)
                else:
                    change = baseline.reset(person, note)
            except OSError as error:
                raise ValueError(_unusable_text(error)) from error
            self._enough.discard(description.unit_key)
            self._store.use(description, baseline.calibration)
            text = self._publish(baseline, baseline.latest_ns)
        if kind is ChangeKind.ACCEPT:
            text = f"the baseline was accepted by {change.author}: the next record gives the level"
        self._actuators.show_learning(description, text, is_learning=kind is ChangeKind.RESET)
        self._announce(description, change, force)
        if kind is ChangeKind.RESET:
            return "the baseline was reset: the unit is learning"
        return f"baseline {change.after} of {counted(change.records, 'record')} is in use"

    def forget(self, actuator_id: str) -> None:
        """Release the baselines of an actuator; its files are kept."""
        with self._lock:
            for key in [key for key in self._open if key[0] == actuator_id]:
                self._open.pop(key).close()

    def close(self) -> None:
        """Release all baselines."""
        with self._lock:
            for baseline in self._open.values():
                baseline.close()
            self._open.clear()

    def _of(self, description: ActuatorDescription) -> UnitBaseline:
        """Return the baseline of a unit, opening it on first use."""
        assert self._folder is not None
        key = description.unit_key
        baseline = self._open.get(key)
        if baseline is None or baseline.description != description:
            if baseline is not None:
                baseline.close()
                del self._open[key]
            has_clock = self._operation.value.has_clock
            baseline = UnitBaseline(self._folder, description, has_clock=has_clock)
            self._open[key] = baseline
            self._store.use(description, baseline.calibration)
        return baseline

    def _doubt(self, baseline: UnitBaseline, kind: ChangeKind) -> str:
        """Return why a change could define a faulty state as healthy; empty if it could not.

        A person who has reset the baseline has confirmed that the unit is healthy.
        """
        if kind is ChangeKind.ACCEPT and baseline.changes:
            return ""
        alarm = self._alarm(baseline.description)
        return f"the unit is not healthy ({alarm})" if alarm else ""

    def _fit(self, baseline: UnitBaseline) -> BaselineChange | None:
        """Fit the candidates if due, and accept the baseline if the settings ask for it.

        Returns the change; None if the baseline was not accepted.
        """
        operation = self._operation.value
        needed, days = operation.accept_after, operation.accept_days
        progress = baseline.progress()
        is_enough = 0 < needed <= progress.records and days <= progress.days
        key = baseline.description.unit_key
        if not baseline.is_fit_due and (not is_enough or key in self._enough):
            return None
        baseline.fit()
        if is_enough:
            self._enough.add(key)
        if not is_enough or baseline.progress().reason or self._doubt(baseline, ChangeKind.ACCEPT):
            return None
        change = baseline.accept(_AUTOMATIC.format(needed), is_automatic=True)
        self._store.use(baseline.description, baseline.calibration)
        return change

    def _publish(self, baseline: UnitBaseline, stamp_ns: int) -> str:
        """Publish the status of a baseline. Return the progress of learning; empty if accepted."""
        progress = baseline.progress(self._operation.value.accept_after)
        self._outputs.publish_baseline(baseline_to_message(baseline, progress, stamp_ns))
        text = "" if baseline.is_accepted else text_of(progress.as_reason)
        status = self._actuators.get(baseline.description.actuator_id)
        if status is not None:
            status.learning = text
        return text


def _unlearnable(description: ActuatorDescription) -> Reason | None:
    """Return why records of a unit cannot be judged; None if they can."""
    return EffortMissing() if description.acquisition.current == "none" else None


def _unusable_text(error: Exception) -> str:
    return text_of(_unusable(error))


def _unusable(error: Exception) -> BaselineUnusable:
    where = f" ({error.filename})" if isinstance(error, InUseError) else ""
    return BaselineUnusable(f"{getattr(error, 'strerror', None) or error}{where}")
