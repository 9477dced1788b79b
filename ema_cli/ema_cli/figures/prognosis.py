# SPDX-License-Identifier: Apache-2.0
"""Picture of a prognosis: remaining life, growth of faults, and end of life."""

from textwrap import fill
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ema_cli.bags.unit_course import Course, true_faults, true_remaining_life
from ema_core.event_kinds import EventKind
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.labels import label_of
from ema_core.levels import ERROR, WARN
from ema_core.wording import counted
from ema_monitor.health import FaultHealth
from ema_monitor.plot.style import (
    BLUE,
    ESTIMATES,
    INK,
    LIMIT,
    ORANGE,
    TRUTH,
    draw_estimates,
    draw_legend,
    stacked_panels,
)
from ema_monitor.prognosis.forecaster import hours_ahead
from ema_monitor.prognosis.growth.prediction import Fan, RemainingLife
from ema_monitor.prognosis.requirements.requirements import BELOW, RequirementLimits
from ema_monitor.prognosis.sentences import removal_text, shown_in

ALPHA: Final = 0.2
"""Half-width of the cone around the true remaining life, relative to that life [-]."""

_MOVES: Final = 0.25
# Each colour is combined with a different line style or marker.
_PREDICTED: Final = BLUE
_CONE: Final = ORANGE
_EVENT: Final = {"color": "0.4", "ls": ":", "lw": 1.1}
_FAN_TIMES: Final = 60
_ESTIMATES: Final[dict[str, Any]] = {**ESTIMATES, "ms": 3, "color": "0.55", "zorder": 2}
_BAND: Final = "predicted, 5 to 95 %"
_MEDIAN: Final = "predicted, median"
_CONE_NAME: Final = f"truth ± {100 * ALPHA:.0f} %"
_TRUTH_NAME: Final = TRUTH["label"]
# A line and the band around it share an entry of the legend.
_BANDS: Final = {
    _MEDIAN: (_BAND, "predicted: median, 5 to 95 %"),
    _TRUTH_NAME: (_CONE_NAME, f"truth, ± {100 * ALPHA:.0f} %"),
}
_TITLE_WIDTH: Final = 105


def draw_course(course: Course) -> Figure:
    """Return a figure of a prognosis over service hours, or test cycles if hours are unknown."""
    last = course.outlooks[-1]
    hours = course.hours
    in_hours = bool(np.isfinite(hours).any())
    place = hours if in_hours else np.array([float(item.cycles) for item in course.outlooks])
    truth = true_faults(course)
    shown = [i for i in range(len(FAULTS)) if _is_shown(course, truth, i)]
    required = last.rul_requirements.criterion if last.rul_requirements.known else ""
    performance = next(
        (i.name for i in last.health.requirements if last.lives[i.name].criterion == required), ""
    )
    heights = [2.4] + [1.7] * (len(shown) + bool(performance))
    figure, panels = stacked_panels(heights, 1.15)
    # Extend the time axis beyond the likely end of life, if it is not far away.
    first, newest = np.nanmin(place), float(np.nanmax(place))
    end = newest + hours_ahead(last.rul, newest - float(first))
    _draw_lives(panels[0], course, place, true_remaining_life(course))
    fan, tracker = None, course.growth.tracker
    # From the hours of the tracker, because the last test may be refused.
    if in_hours and tracker.updates and (ahead := end - tracker.hours) > 0.0:
        times = ahead * np.linspace(0.0, 1.0, _FAN_TIMES)
        fan = tracker.fan(times, last.future)
    for axes, i in zip(panels[1:], shown, strict=False):
        _draw_fault(axes, course, place, truth, i, fan)
    if performance:
        _draw_requirement(panels[-1], course, place, performance)
    for axes in panels:
        _mark_events(axes, course, place, is_named=axes is panels[0])
    panels[-1].set_xlabel(
        "service hours [h]" if in_hours else "test cycle (no service hours known)"
    )
    panels[-1].set_xlim(min(first, end), end)
    unit = course.record.description
    name = f"{unit.actuator_id} ({unit.serial_number})"
    title = f"{name}, {counted(len(course.outlooks), 'valid test')}"
    title += f"\n{fill(removal_text(course.now), _TITLE_WIDTH)}"
    panels[0].set_title(title, loc="left", fontsize="medium")
    figure.align_ylabels(panels)
    draw_legend(figure, panels, _BANDS)
    return figure


def _is_shown(course: Course, truth: NDArray[np.float64], i: int) -> bool:
    """Return whether a fault has a panel.

    It has a panel if it is the worst, ends life, causes a warning, or its true value changes.
    """
    name = FAULT_NAMES[i]
    if name not in COMPONENTS:
        return False
    last, limit = course.outlooks[-1], course.options.prognosis.limits.of(name)
    is_predicted = [item for item in last.health.faults if np.isfinite(item.share)]
    worst = max(is_predicted, key=lambda item: item.share).name if is_predicted else ""
    ends_life = last.rul_faults.known and last.lives[name].criterion == last.rul_faults.criterion
    moved = np.abs(truth[:, i] - FAULTS[i].healthy) > _MOVES * limit
    warns = _of(last.health.faults, name).level in (WARN, ERROR)
    return bool(name == worst or ends_life or warns or moved.any())


def _draw_lives(
    axes: Axes, course: Course, place: NDArray[np.float64], truth: NDArray[np.float64]
) -> None:
    lives = [outlook.rul for outlook in course.outlooks]
    low, median, high = (
        np.array([getattr(life, name) for life in lives])
        for name in ("hours_05", "hours_50", "hours_95")
    )
    is_predicted = np.array([life.known for life in lives])
    if np.isfinite(truth).any():
        cone = axes.fill_between(
            place, (1.0 - ALPHA) * truth, (1.0 + ALPHA) * truth, color=_CONE, alpha=0.3, lw=0
        )
        cone.set_label(_CONE_NAME)
        axes.plot(place, truth, **TRUTH)
    # Limit the axis: early bands may be infinite, and the first medians depend on the prior only.
    high_median = np.quantile(median[is_predicted], 0.9) if is_predicted.any() else 0.0
    top = np.nanmax([1.0, *(2.0 * truth if np.isfinite(truth).any() else [1.5 * high_median])])
    drawn_high = np.where(np.isinf(high), 10.0 * top, high)
    if is_predicted.any():
        band = axes.fill_between(
            place, low, drawn_high, where=is_predicted.tolist(), color=_PREDICTED, alpha=0.2, lw=0
        )
        band.set_label(_BAND)
        axes.plot(place, median, "--", marker=".", color=_PREDICTED, lw=1.4, label=_MEDIAN)
    if not is_predicted.all():
        none = np.zeros(int((~is_predicted).sum()))
        axes.plot(
            place[~is_predicted],
            none,
            "|",
            color="0.45",
            ms=9,
            label="no prediction",
            clip_on=False,
        )
    axes.set_ylim(0.0, top)
    axes.set_ylabel("remaining useful\nlife [h]")


def _draw_fault(
    axes: Axes,
    course: Course,
    place: NDArray[np.float64],
    truth: NDArray[np.float64],
    i: int,
    fan: Fan | None,
) -> None:
    fault, last = FAULTS[i], course.outlooks[-1]
    estimates = [step.estimate for step in course.valid]
    value = np.array([estimate.faults[i] for estimate in estimates])
    draw_estimates(axes, place, value, [estimate.sigma[i] for estimate in estimates], **_ESTIMATES)
    if np.isfinite(truth[:, i]).any():
        axes.plot(place, truth[:, i], zorder=3, **TRUTH)
    tracked = [_of(outlook.health.faults, fault.name).value for outlook in course.outlooks]
    axes.plot(place, tracked, "-", color=_PREDICTED, lw=1.6, label="tracked", zorder=4)
    if fan is not None:
        low, median, high = fan.values[fault.name]
        ahead = course.growth.tracker.hours + fan.hours
        axes.fill_between(ahead, low, high, color=_PREDICTED, alpha=0.2, lw=0, label=_BAND)
        axes.plot(ahead, median, "--", color=_PREDICTED, lw=1.4, label=_MEDIAN)
    limit = course.options.prognosis.limits.of(fault.name)
    ends = [fault.healthy + limit] + [fault.healthy - limit] * (fault.healthy > 0.0)
    for end in ends:
        axes.axhline(end, **LIMIT)
    nearest = min(ends, key=lambda end: abs(end - tracked[-1]))
    crossed = _crossing(place, np.array(tracked), nearest, last.flight_hours)
    _mark_life(axes, last.flight_hours, last.lives[fault.name], nearest, crossed)
    # Tests that do not show the fault have no value.
    drawn = np.array([*value, *tracked, *ends])
    least, most = float(np.nanmin(drawn)), float(np.nanmax(drawn))
    least = min(least, fault.healthy)
    axes.set_ylim(least - 0.06 * (most - least), most + 0.12 * (most - least))
    axes.set_ylabel(fault.label)


def _draw_requirement(axes: Axes, course: Course, place: NDArray[np.float64], name: str) -> None:
    unit, scale = shown_in(RequirementLimits.unit(name))
    items = [_of(outlook.health.requirements, name) for outlook in course.outlooks]
    value = scale * np.array([item.value for item in items])
    sigma = scale * np.array([item.sigma for item in items])
    draw_estimates(axes, place, value, sigma, **_ESTIMATES)
    limit, last = scale * items[-1].limit, course.outlooks[-1]
    axes.axhline(limit, **LIMIT)
    axes.text(
        0.006,
        limit,
        "fails below" if name in BELOW else "fails above",
        transform=axes.get_yaxis_transform(),
        va="top" if name in BELOW else "bottom",
        fontsize="small",
    )
    crossed = _crossing(place, value, limit, last.flight_hours)
    _mark_life(axes, last.flight_hours, last.lives[name], limit, crossed)
    axes.margins(y=0.15)
    axes.set_ylabel(label_of(name) + (f"\n[{unit.strip()}]" if unit else ""))


def _crossing(
    place: NDArray[np.float64], value: NDArray[np.float64], level: float, now: float
) -> float:
    """Return the position where values last crossed a level.

    Return ``now`` if they never did, or if the last value is on the same side as the first.
    """
    left = (level - value) * np.sign(level - value[0])
    before = np.flatnonzero(left > 0.0)
    if not before.size or (k := before[-1]) + 1 == left.size:
        return now
    return float(np.interp(0.0, [left[k + 1], left[k]], [place[k + 1], place[k]]))


def _mark_life(axes: Axes, now: float, life: RemainingLife, level: float, crossed: float) -> None:
    """Mark the end of life (5 %, 50 %, 95 %) on the line of a limit, or where it was crossed."""
    if not life.known:
        return
    ends = now + np.array([life.hours_05, life.hours_50, life.hours_95])
    if life.hours_95 <= 0.0:
        ends[:] = crossed
    axes.plot(ends[[0, 2]], [level, level], "-", color=INK, lw=3.0, solid_capstyle="butt", zorder=5)
    axes.plot(ends[1], level, "D", color=INK, ms=5, label="end of life, 5 / 50 / 95 %", zorder=6)


def _mark_events(axes: Axes, course: Course, place: NDArray[np.float64], *, is_named: bool) -> None:
    marked = [
        (x, event)
        for x, outlook in zip(place, course.outlooks, strict=True)
        for event in (outlook.events if np.isfinite(x) else ())
        # Missing tests have no point, and the lines of the limits show faults.
        if event.kind not in (EventKind.GAP, EventKind.FAULT)
    ]
    for number, (x, event) in enumerate(marked):
        axes.axvline(x, label="event", **_EVENT)
        if is_named:
            axes.annotate(
                label_of(event.kind),
                (x, 0.98),
                xycoords=axes.get_xaxis_transform(),
                rotation=90,
                # Alternate sides: an outlier and its interpretation are at neighbouring tests.
                ha="left" if number % 2 else "right",
                va="top",
                fontsize="x-small",
                color="0.3",
            )


def _of(items: tuple[FaultHealth, ...], name: str) -> FaultHealth:
    return next(item for item in items if item.name == name)
