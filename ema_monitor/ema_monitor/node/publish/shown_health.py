# SPDX-License-Identifier: Apache-2.0
"""Published health of one actuator, and its expiry."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final, Protocol

from ema_core.description import ActuatorDescription
from ema_core.levels import LEVEL_NAMES, OK, STALE
from ema_interfaces.msg import Health as HealthMessage
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.joint.comparison import Comparison
from ema_monitor.node.moment import Moment
from ema_monitor.node.publish.messages import health_to_message
from ema_monitor.prognosis.events import UnitEvent
from ema_monitor.prognosis.outlook import Claim, Outlook, unknown_outlook

_NOTHING_KNOWN: Final = unknown_outlook("no valid estimate so far")


class Stream(Protocol):
    """Reception state of an actuator's telemetry."""

    has_streamed: bool
    """Whether the actuator has ever sent telemetry while measuring it."""


class ShownHealth:
    """The published health of one actuator.

    Parameters
    ----------
    publish
        Publishes a health message.
    steady_ns
        Current monotonic time [ns].
    described
        Returns the latest description of the actuator; None until it is described.
    stream
        Reception state of its telemetry.

    Attributes
    ----------
    outlook
        Health and life after the latest valid estimate.
    comparison
        Comparison of the latest record of the mounted unit; None for a modelled drive.
    """

    def __init__(
        self,
        publish: Callable[[HealthMessage], None],
        steady_ns: int,
        described: Callable[[], ActuatorDescription | None],
        stream: Stream,
    ) -> None:
        self._publish = publish
        self._described = described
        self._stream = stream
        self.reset(steady_ns)

    def reset(self, steady_ns: int) -> None:
        """Reset the health after the unit was replaced."""
        self.comparison: Comparison | None = None
        # Newest test of the outlook, when it was first published, and why its level is invalid.
        self._claimed_test, self._claimed_at = (0, 0), Moment(0, 0)
        self._end_of_claim = self._doubt = ""
        self._added_ns = steady_ns
        self._is_withdrawn = False
        self._assessed: ActuatorDescription | None = None
        self.outlook = _NOTHING_KNOWN

    def record(self, diagnosed: Diagnosed, outlook: Outlook, now: Moment) -> str | None:
        """Publish the outlook after an estimate. Return a description of the level change.

        The description is empty if the level is unchanged. If the unit was replaced while its last
        window was queued, the outlook is published but not stored, and None is returned.
        """
        if not self._is_mounted(diagnosed.description):
            self._publish(health_to_message(outlook, diagnosed.description))
            return None
        self.comparison = diagnosed.estimate.comparison
        return self._show(diagnosed.description, outlook, now)

    def resume(self, description: ActuatorDescription, outlook: Outlook, now: Moment) -> str | None:
        """Publish the health after the newest test in the history, unless already published.

        It is published again when requirements become available. Return a description of the level
        change, "" if the level is unchanged, or None if nothing was published.
        """
        if not self._is_mounted(description):
            return None
        before = self.outlook
        is_shown = self._assessed is not None and not self._is_withdrawn
        if is_shown and (
            before.claim.tested_ns != outlook.claim.tested_ns
            or before.health.requirements
            or not outlook.health.requirements
        ):
            return None
        return self._show(description, outlook, now)

    def add_events(self, events: tuple[UnitEvent, ...]) -> None:
        """Publish the unchanged health again with new events, if any health is published."""
        if self._assessed is not None and not self._is_withdrawn:
            self.outlook = replace(self.outlook, events=(*self.outlook.events, *events))
            self._publish_as_is()

    def expire(
        self, good_for_s: float, now: Moment, defects: str, learning: str = ""
    ) -> HealthMessage | None:
        """Publish the health if it has just become stale. Return the message, if published.

        ``defects`` describes the defects since the latest valid estimate, and ``learning`` the
        progress of a baseline that is being learned.
        """
        if not self._added_ns:
            self._added_ns = now.steady_ns  # simulated time has begun
        if self._is_withdrawn:
            return None
        if self.outlook is _NOTHING_KNOWN:
            is_due = (now.steady_ns - self._added_ns) * 1e-9 > good_for_s
            reason = f"no valid estimate for more than {good_for_s:g} s"
        else:
            # The expected period may have changed.
            claim = self.outlook.claim._replace(good_for_s=good_for_s)
            self.outlook = replace(self.outlook, claim=claim)
            worth = self.worth(self.outlook, now)
            is_due, reason = worth is not self.outlook, worth.health.reason
        if not is_due:
            return None
        return self.withdraw(learning or "; ".join(filter(None, [reason, defects])))

    def withdraw(self, reason: str) -> HealthMessage | None:
        """Publish unknown health with a reason. Return the message; None if not yet described."""
        self.outlook = self.outlook.stale(reason)
        self._is_withdrawn = True
        return self._publish_as_is()

    def end_claim(self, reason: str) -> HealthMessage | None:
        """Invalidate the level of all tests so far. Return the message; None without a level."""
        self._end_of_claim = reason
        is_known = self._assessed is not None and self.outlook.health.level != STALE
        return self.withdraw(reason) if is_known else None

    def worth(self, outlook: Outlook, now: Moment) -> Outlook:
        """Return the outlook at a time; STALE once its validity has ended on the steady clock.

        Expired validity is never renewed, even if the stamp clock steps back.
        """
        claim = outlook.claim
        test = claim.tested_ns, claim.received_ns
        if test != self._claimed_test:
            self._claimed_test, self._claimed_at, self._end_of_claim = test, now, ""
            self._doubt = self._doubt_of(claim, now)
        reason = self._end_of_claim or (self._doubt if outlook.health.level == OK else "")
        if reason:
            return outlook.stale(reason) if outlook.health.level != STALE else outlook
        passed_ns = now.steady_ns - self._claimed_at.steady_ns
        worth = outlook.at(max(now.clock_ns, self._claimed_at.clock_ns + passed_ns))
        if worth.health.level == STALE:
            self._end_of_claim = worth.health.reason
        return worth

    def _doubt_of(self, claim: Claim, now: Moment) -> str:
        """Return why the time of the newest test is uncertain; empty if it is certain."""
        if not claim.good_for_s or claim.is_live or not now.is_real:
            return ""
        if not (claim.received_ns or now.is_continued):
            return "the monitor was started after the newest test: the next test gives the level"
        if claim.tested_ns <= now.passed_ns:
            return (
                "the newest test may have been measured before the clock went back: the next test "
                "that is received while it is measured gives the level"
            )
        if claim.is_ahead or (self._stream.has_streamed and not claim.is_dated):
            return (
                "the stamp of the newest test does not show when it was measured: send telemetry "
                "while it is measured, or set the clock of the actuator"
            )
        return ""

    def _show(self, description: ActuatorDescription, outlook: Outlook, now: Moment) -> str:
        """Publish an outlook. Return a description of the level change, if any."""
        self._is_withdrawn = False
        before = self.outlook.known_level
        self._assessed, self.outlook = description, self.worth(outlook, now)
        level, change = self.outlook.health.level, ""
        if level not in (STALE, before):
            dominant = f": {outlook.dominant_fault}" if outlook.dominant_fault else ""
            change = f"health {LEVEL_NAMES[before]} -> {LEVEL_NAMES[level]}{dominant}"
        self._publish_as_is()
        return change

    def _is_mounted(self, description: ActuatorDescription) -> bool:
        """Return whether a description has the serial number of the latest description."""
        latest = self._described()
        return latest is not None and latest.serial_number == description.serial_number

    def _publish_as_is(self) -> HealthMessage | None:
        """Publish and return the health of the latest assessed unit, or of the described unit."""
        description = self._assessed or self._described()
        if description is None:
            return None
        health = health_to_message(self.outlook, description)
        # Each event is published once.
        self.outlook = replace(self.outlook, events=())
        self._publish(health)
        return health
