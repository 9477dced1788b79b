# SPDX-License-Identifier: Apache-2.0
"""Prognosis as tables, sentences and plain values."""

import math
from collections.abc import Sequence
from dataclasses import is_dataclass
from typing import Any, Final

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from ema_cli.bags.unit_course import Course
from ema_core.event_kinds import EventKind
from ema_core.labels import label_of
from ema_core.levels import LEVEL_NAMES
from ema_monitor.prognosis.event_texts import event_text
from ema_monitor.prognosis.growth.check import AHEAD
from ema_monitor.prognosis.sentences import TREND_HOURS, shown_in
from ema_monitor.reports import HealthReport, ItemReport, LifeReport, ScenarioReport, health_report

_ACTIONS: Final = {
    "continue": "Continue, and decide again after the next test",
    "inspect": "Inspect",
    "remove": "Remove",
    "unknown": "No advice",
}

WIDENED: Final = 1.05
"""Smallest factor of a widening of predictions that is reported [-]."""


def as_values(report: Any) -> Any:
    """Return a report as plain values; NaN and infinity become None."""
    if is_dataclass(report) and not isinstance(report, type):
        return as_values(vars(report))
    if isinstance(report, dict):
        return {name: as_values(value) for name, value in report.items()}
    if isinstance(report, list | tuple):
        return [as_values(item) for item in report]
    if isinstance(report, float):
        return report if math.isfinite(report) else None
    return report.item() if isinstance(report, np.generic) else report


def course_as_values(course: Course) -> list[dict[str, Any]]:
    """Return estimate, health and life after each test as plain values."""
    values = []
    for step in course.steps:
        item: dict[str, Any] = {
            "start_ns": step.estimate.start_ns,
            "end_ns": step.estimate.end_ns,
            "valid": step.estimate.valid,
            "reason": step.estimate.reason,
        }
        if step.estimate.comparison is not None:
            item["comparison"] = as_values(step.estimate.comparison.as_mapping())
        if step.outlook is not None:
            reported = as_values(health_report(step.outlook, course.record.description.unit_key))
            kept = ("flight_hours", "cycles", "level", "health_index", "dominant_fault", "events")
            lives = ("rul_faults", "rul_requirements", "rul")
            item |= {name: reported[name] for name in (*kept, *lives)}
        values.append(item)
    return values


def table_of_growth(report: HealthReport, *, are_records: bool = False) -> Table:
    """Return a table of faults and requirements with limits, growth and remaining life.

    With ``are_records``, the table omits faults without a value, because a record shows only some.
    """
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    for heading in ("", "value", "sigma", "limit", f"per\n{TREND_HOURS:g} h"):
        table.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    table.add_column("RUL [h]\n5 / 50 / 95 %", justify="right", min_width=18)
    faults, requirements = report.faults, report.requirements
    if are_records:
        # A record shows at most two of the faults.
        faults = tuple(item for item in faults if math.isfinite(item.value))
    items = (*faults, *requirements)
    reasons = {item.rul.reason for item in items}
    for number, item in enumerate(items):
        if number == len(faults):
            table.add_section()
        unit, scale = shown_in(item.unit)
        side = "≥" if item.limit_is_lower else "≤"
        table.add_row(
            label_of(item.name) + (rf" \[{unit.strip()}]" if unit else ""),
            _figure(scale * item.value),
            _figure(scale * item.sigma),
            f"{side} {scale * item.limit:.4g}",
            _figure(scale * TREND_HOURS * item.trend, sign="+"),
            # A reason common to all rows is printed below the table.
            "unknown" if len(reasons) == 1 and not item.rul.known else _life(item.rul),
        )
    return table


def table_of_scenarios(reports: Sequence[ScenarioReport]) -> Table:
    """Return a table with the remaining life for each scenario, and what limits it."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True)
    table.add_column("scenario")
    for unit in ("h", "cycles", "days"):
        table.add_column(rf"RUL \[{unit}]" + "\n5 / 50 / 95 %", justify="right", min_width=14)
    table.add_column("ended by")
    for report in reports:
        life = report.rul
        cycles = (life.cycles_05, life.cycles_50, life.cycles_95)
        days = (report.days_05, report.days_50, report.days_95)
        table.add_row(
            escape(report.name),
            _life(life),
            *(_quantiles(each) if life.known else "" for each in (cycles, days)),
            label_of(report.dominant_fault),
        )
    return table


def summary(course: Course, report: HealthReport) -> list[str]:
    """Return lines on remaining life, health, assumptions and events."""
    lives = {
        "by faults": report.rul_faults,
        "by requirements": report.rul_requirements,
        "overall, the earlier": report.rul,
    }
    lines = []
    for name, life in lives.items():
        # The sentence on removal already states the reason of the overall life.
        repeats = not life.known and life.reason in ("", report.rul.reason)
        lines.append(f"remaining useful life {name}: {'unknown' if repeats else _life_text(life)}")
    level = LEVEL_NAMES[report.level]
    if report.level != report.last_level:
        level += f" (last {LEVEL_NAMES[report.last_level]})"
    first = label_of(report.dominant_fault)
    first = f"; first to end life: {first}" if first else ""
    is_finite = math.isfinite(report.health_index)
    index = f"{report.health_index:.2f}" if is_finite else "unknown"
    lines.append(
        f"health index {index}, level {level}, severity "
        f"{report.severity} of 4, confidence {report.confidence:.2f}{first}"
    )
    lines += _checked(report.faults)
    lines.append(f"assumption: {report.assumption} (growth factor {report.growth_factor:g})")
    missed = []
    for outlook in course.outlooks:
        place = (
            f"{outlook.flight_hours:.6g} h"
            if math.isfinite(outlook.flight_hours)
            else "an unknown hour"
        )
        for event in outlook.events:
            if event.kind is EventKind.GAP:
                missed.append(place)
            else:
                lines.append(f"event at {place}: {event_text(event)}")
    if missed:
        lines.append(f"missed tests before {', '.join(missed)}")
    if reason := course.now.health.reason:
        lines.append(f"note: {reason}")
    return lines


def _life(life: LifeReport) -> str:
    if not life.known:
        return f"[dim]{life.reason or 'unknown'}[/]"
    return _quantiles((life.hours_05, life.hours_50, life.hours_95))


def _quantiles(values: tuple[float, float, float]) -> str:
    """Return quantiles as a string, or "" if they are NaN."""
    return "" if math.isnan(values[0]) else " / ".join(map(_hours, values))


def _checked(faults: Sequence[ItemReport]) -> list[str]:
    """Return a line on how well later tests confirmed the predictions; empty if unknown."""
    text = [
        f"{label_of(item.name)} {_figure_of_check(item.score_rms)} for the next test, "
        f"{_figure_of_check(item.score_rms_ahead)} for {AHEAD} tests ahead"
        + (f", widened by {item.widening:.2f}" if item.widening > WIDENED else "")
        for item in faults
        if item.rul.known and math.isfinite(item.score_rms)
    ]
    return ["calibration of predictions so far (1 is ideal): " + "; ".join(text)] if text else []


def _figure_of_check(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "unknown"


def _life_text(life: LifeReport) -> str:
    if not life.known:
        return f"unknown ({life.reason})"
    cycles = (life.cycles_05, life.cycles_50, life.cycles_95)
    in_cycles = ""
    if np.isfinite(life.cycles_50):
        in_cycles = f" ({' / '.join(_hours(cycle) for cycle in cycles)} cycles)"
    return f"{_life(life)} h{in_cycles}, 5 / 50 / 95 %, until {life.criterion}"


def _hours(value: float) -> str:
    if not math.isfinite(value):
        return "longer"
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"


def _figure(value: float, sign: str = "") -> str:
    return f"{value:{sign}.4f}" if math.isfinite(value) else "-"


def advice_text(course: Course) -> str:
    """Return a sentence with action, time, cost and reason, or "" without costs."""
    advice, costs = course.advice, course.options.costs
    if advice is None or costs is None:
        return ""
    words = _ACTIONS[advice.action]
    if math.isfinite(advice.flight_hours):
        joined = ", at" if advice.action == "continue" else " by"
        words += f"{joined} {advice.flight_hours:,.0f} service hours (in {advice.from_now:,.0f} h)"
    parts = [f"{words}: {advice.reason}"]
    if math.isfinite(advice.expected_cost):
        unit = f"{costs.unit}/h".lstrip("/") if costs.unit else "an hour"
        parts.append(
            f"expected cost over the life {advice.expected_cost:.3g} {unit}, "
            f"{advice.cost_of_immediate_removal:.3g} if it is removed as early as possible"
        )
    if math.isfinite(advice.probability_of_failure):
        parts.append(f"risk of failure until then {100.0 * advice.probability_of_failure:.2g} %")
    return "; ".join(parts)
