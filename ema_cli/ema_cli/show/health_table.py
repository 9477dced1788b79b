# SPDX-License-Identifier: Apache-2.0
"""Display of published health: a live table on a terminal, otherwise one line per change."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ema_cli.bags.diagnoses import quantity_of
from ema_cli.show.terminal import COLOURS, TerminalDisplay, level_text
from ema_core.causes import CauseEstimate
from ema_core.labels import label_of
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.wording import beside_limit, counted, time_text
from ema_interfaces.msg import FaultEstimate
from ema_monitor.joint.wording import brief
from ema_monitor.prognosis.sentences import SOON_HOURS, shown_in
from ema_monitor.quantities import FRICTION
from ema_monitor.reasons import Learning
from ema_ros.claims import Received, worth
from ema_ros.stamps import stamp_from_message

_URGENCY: Final = {OK: 0, WARN: 1, STALE: 2, ERROR: 3}
_LINES_BESIDE: Final = 6
_LEARNING_SHAPE: Final = "◌"
_REASONS: Final = 3
"""Number of actuators shown with reasons, worst first."""


@dataclass(frozen=True)
class Row:
    """Table row of an actuator."""

    place: str
    """Namespace of its monitor."""
    actuator_id: str
    serial_number: str
    level: int
    """Current level of health; STALE after the health has expired."""
    last_level: int
    """Level before it became STALE; equal to ``level`` otherwise."""
    health_index: float
    """Health index, 1 for healthy and 0 at a limit [-]; NaN if unknown."""
    dominant: str
    """Value, sigma and limit of the life-limiting or worst fault or requirement; "" if none."""
    life: tuple[float, float, float] | None
    """Quantiles of the remaining life, 5, 50 and 95 % [h]; None if unknown."""
    must_remove: bool
    """Whether to remove the unit now."""
    remove_before: float
    """Service hour before which to remove the unit [h]; NaN if unknown."""
    test_ns: int
    """Timestamp of the last test [ns]; 0 before the first test."""
    test_age_s: float
    """Time since the last test [s], or since its reception if timestamps use a different clock."""
    why: str
    """Reason for the level, and for a refusal of the last test."""
    learning: str = ""
    """Number of collected records of a unit that is learning its baseline; "" otherwise."""

    @property
    def level_text(self) -> str:
        """Level with its shape; progress if the unit is learning, the last alarm if it is stale."""
        if self.learning:
            return f"{_LEARNING_SHAPE} LEARNING {self.learning}"
        text = level_text(self.level)
        is_hidden = self.level == STALE and self.last_level in (WARN, ERROR)
        return f"{text}, was {LEVEL_NAMES[self.last_level]}" if is_hidden else text

    @property
    def content(self) -> tuple[Any, ...]:
        """Content without ages; without a terminal, a change of it prints a new line."""
        index = f"{self.health_index:.2f}"
        return (self.level_text, index, self.dominant, self.life, self.test_ns, self.why)


@dataclass
class _Actuator:
    """Latest messages about an actuator, with reception times [s]."""

    received: Received | None = None
    baseline: Any = None
    refused: Any = None
    causes: str = ""
    friction: str = ""
    tested_s: float = math.nan


class LatestHealths:
    """Latest messages about each actuator. ``now_s`` is the time of a monotonic clock [s]."""

    def __init__(self) -> None:
        self._actuators: dict[tuple[str, str], _Actuator] = {}

    def add_health(self, place: str, message: Any, now_s: float, clock_ns: int) -> None:
        """Add a Health message from a namespace, received at the ROS time ``clock_ns`` [ns]."""
        item = self._of(place, message)
        before, item.received = item.received, Received.at(message, clock_ns, now_s)
        if before is None or before.health.header.stamp != message.header.stamp:
            item.tested_s = now_s

    def add_estimate(self, place: str, message: Any, now_s: float) -> None:
        """Add a FaultEstimate message; its causes or friction are shown with the health.

        If it is not valid, its reason is shown as well, until the next valid estimate.
        """
        item = self._of(place, message)
        if message.valid:
            item.refused = None
            item.causes = ", ".join(
                str(CauseEstimate(cause.name, cause.value, cause.sigma)) for cause in message.causes
            )
            item.friction = ", ".join(
                brief(quantity_of(quantity))
                for quantity in message.quantities
                if quantity.name == FRICTION
            )
        else:
            item.refused, item.tested_s = message, now_s

    def add_baseline(self, place: str, message: Any) -> None:
        """Add a BaselineStatus message; its progress replaces the level of a learning unit."""
        self._of(place, message).baseline = message

    def rows(
        self,
        now_s: float,
        clock_ns: int,
        is_silent: Callable[[str, str], bool],
        *,
        is_real: bool = True,
    ) -> list[Row]:
        """Return a row per actuator with known health, worst first.

        Parameters
        ----------
        now_s
            Time of a monotonic clock [s].
        clock_ns
            Time of the ROS clock [ns].
        is_silent
            Function that returns whether a monitor is silent, called with its namespace and the
            author of its health.
        is_real
            Whether time is real. In simulated time, health expires only by the ROS clock.
        """
        rows = [
            self._row(key, item, received, now_s, clock_ns, is_real, is_silent)
            for key, item in self._actuators.items()
            if (received := item.received) is not None
        ]
        return sorted(rows, key=_order)

    def _of(self, place: str, message: Any) -> _Actuator:
        return self._actuators.setdefault((place, message.actuator_id), _Actuator())

    def _row(
        self,
        key: tuple[str, str],
        actuator: _Actuator,
        received: Received,
        now_s: float,
        clock_ns: int,
        is_real: bool,
        are_silent: Callable[[str, str], bool],
    ) -> Row:
        is_silent = are_silent(key[0], received.health.author)
        ended_s = received.ended_s(clock_ns, now_s, is_real=is_real)
        health = worth(received.health, ended_s, is_silent=is_silent)
        reasons = [received.health.cause or received.health.reason]
        if health is not received.health:
            reasons.insert(0, health.reason)
        test_ns = stamp_from_message(health.header.stamp)
        if actuator.refused is not None:
            test_ns = max(test_ns, stamp_from_message(actuator.refused.header.stamp))
            # After a refused test the level is unknown, but not after a departed or failed one. The
            # health then states the same reason; with any other level it has a reason of its own.
            gives_level = actuator.refused.verdict in (FaultEstimate.DEPARTED, FaultEstimate.FAILED)
            is_of_test = received.health.tested == actuator.refused.header.stamp
            is_stated = is_of_test and gives_level != (received.health.level == STALE)
            if not is_stated and list(actuator.refused.reason_codes) != [Learning.code]:
                reasons.append(f"last test refused: {actuator.refused.reason}")
        elif actuator.friction:
            reasons.append(actuator.friction)
        elif actuator.causes:
            reasons.append(f"hidden cause: {actuator.causes}")
        age_s = (clock_ns - test_ns) * 1e-9
        life = health.rul
        hours = (life.hours_05, life.hours_50, life.hours_95) if life.known else None
        return Row(
            *key,
            serial_number=health.serial_number,
            level=health.level,
            last_level=health.last_level if health.level == STALE else health.level,
            health_index=health.health_index,
            dominant=_dominant_text(health),
            life=hours,
            must_remove=_must_remove(health),
            remove_before=health.flight_hours + _removal_hours(health),
            test_ns=test_ns,
            test_age_s=age_s if age_s >= 0.0 else now_s - actuator.tested_s,
            why="; ".join(filter(None, reasons)),
            learning="" if is_silent else _learning(actuator.baseline, health),
        )


def _learning(baseline: Any, health: Any) -> str:
    """Return the progress of a unit that is learning, such as "3 of 10", or "" for other units."""
    if baseline is None or baseline.state != baseline.LEARNING or health.level != STALE:
        return ""
    if baseline.serial_number != health.serial_number:
        return ""
    needed = f" of {baseline.records_needed}" if baseline.records_needed else ""
    return f"{baseline.records}{needed}"


def _order(row: Row) -> tuple[Any, ...]:
    urgency = max(_URGENCY[row.level], _URGENCY[row.last_level])
    index = row.health_index if math.isfinite(row.health_index) else 0.0
    return (-urgency, row.life[0] if row.life else math.inf, index, row.place, row.actuator_id)


def _dominant_text(health: Any) -> str:
    """Return the dominant fault or requirement with value, sigma and limit, or "" if none."""
    for item in (*health.faults, *health.requirements):
        if item.name == health.dominant_fault:
            unit, scale = shown_in(item.unit)
            side = "≥" if item.limit_is_lower else "≤"
            sigma = f" ± {scale * item.sigma:.2g}" if math.isfinite(item.sigma) else ""
            value, limit = beside_limit(scale * item.value, scale * item.limit)
            return f"{label_of(item.name)} {value}{sigma}{unit} ({side} {limit})"
    return ""


def _must_remove(health: Any) -> bool:
    """Return whether a limit is exceeded or the removal is due within ``SOON_HOURS``."""
    has_failed = any(item.level == ERROR for item in (*health.faults, *health.requirements))
    return has_failed or _removal_hours(health) < SOON_HOURS


def _removal_hours(health: Any) -> float:
    """Return the hours until the removal is due [h]; NaN if the remaining life is unknown."""
    if not health.rul.known:
        return math.nan
    # Recordings of earlier versions have no removal hours.
    return health.removal_hours if health.removal_risk > 0.0 else health.rul.hours_05


def _removal(row: Row, before: str = "") -> str:
    """Return "now", or ``before`` and the service hour of the removal; "" if it is unknown."""
    if row.must_remove:
        return "now"
    return f"{before}{row.remove_before:,.0f} h" if math.isfinite(row.remove_before) else ""


class HealthTable(TerminalDisplay):
    """Table with one row per actuator; a context manager."""

    def __init__(self, title: str, console: Console | None = None) -> None:
        super().__init__(console)
        self._title = title
        self._printed: dict[tuple[str, str], tuple[object, ...]] = {}
        self._printed_state = ""

    def show(self, rows: Sequence[Row], state: str) -> None:
        """Show the rows of the actuators, and ``state`` as a note.

        Without a terminal, print only the rows that have changed, and ``state`` if there is no row.
        """
        if self._console.is_terminal:
            self._live.update(self._actuators(rows, state), refresh=True)
            return
        for row in rows:
            key = row.place, row.actuator_id
            if self._printed.get(key) != row.content:
                self._printed[key] = row.content
                click.echo(f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC  {_line(row)}")
        if not rows and state != self._printed_state:
            click.echo(state, err=True)
        self._printed_state = state

    def _actuators(self, rows: Sequence[Row], state: str) -> Table:
        several = len({row.place for row in rows}) > 1
        shown = rows[: max(3, self._console.height - _LINES_BESIDE)]
        reasons = [f"{row.actuator_id}: {row.why}" for row in shown[:_REASONS] if row.why]
        title = f"{counted(len(rows), 'actuator')} {self._title}"
        table = self._table(title, *reasons, state)
        table.add_column("actuator")
        table.add_column("level", no_wrap=True)
        table.add_column("index", justify="right", no_wrap=True)
        table.add_column("dominant (limit)")
        table.add_column("RUL [h]\n50 % (5 to 95)", justify="right")
        table.add_column("remove\nbefore", justify="right")
        table.add_column("last\ntest", justify="right")
        for row in shown:
            table.add_row(
                Text(f"{row.place}/{row.actuator_id}" if several else row.actuator_id),
                Text(row.level_text, COLOURS[row.level]),
                _index(row),
                Text(row.dominant or "-"),
                _life(row),
                _removal(row) or "-",
                time_text(row.test_age_s) if row.test_ns else "-",
            )
        return table


def _index(row: Row) -> str:
    return f"{row.health_index:.2f}" if math.isfinite(row.health_index) else "-"


def _life(row: Row) -> str:
    if row.life is None:
        return "unknown"
    low, median, high = (f"{hours:,.0f}" if math.isfinite(hours) else "more" for hours in row.life)
    return f"{median} ({low} to {high})"


def _line(row: Row) -> str:
    """Format the row of an actuator as a line of text."""
    if row.learning:
        return "  ".join((row.level_text, f"{row.place}/{row.actuator_id}", row.why))
    life = _life(row)
    removal = _removal(row, "before ")
    parts = (
        row.level_text,
        f"{row.place}/{row.actuator_id} ({row.serial_number})",
        f"index {_index(row)}",
        row.dominant,
        f"RUL {life}{' h' * (row.life is not None)}",
        f"remove {removal}" if removal else "",
        f"last test {time_text(row.test_age_s)} ago" if row.test_ns else "no test yet",
        row.why,
    )
    return "  ".join(filter(None, parts))
