"""Picture of a prognosis: remaining life, growth of the faults, and what ends life."""

from textwrap import fill
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ema_cli.bags.history import SHOWN_IN
from ema_cli.bags.unit_course import Course
from ema_cli.lives.true_life import true_faults, true_remaining_life
from ema_core.faults import COMPONENTS, FAULT_NAMES, FAULTS
from ema_core.levels import ERROR, WARN
from ema_monitor.health import FaultHealth
from ema_monitor.prognosis.growth.prediction import Fan, RemainingLife
from ema_monitor.prognosis.metrics import ALPHA
from ema_monitor.prognosis.requirements.requirements import BELOW, RequirementLimits

_MOVES: Final = 0.25
_SIGMAS_OF_90_PERCENT: Final = 1.645
# Of the palette of Okabe and Ito, which colour-blind people tell apart; each also has its line
# style or marker.
_PREDICTED: Final = "#0072b2"
_BY_FAULTS: Final = "#009e73"
_BY_REQUIREMENTS: Final = "#cc79a7"
_CONE: Final = "#e69f00"
_TRUTH: Final = {"color": "0.1", "lw": 1.5, "ls": (0, (6, 2))}
_LIMIT: Final = {"color": "#d55e00", "ls": (0, (4, 3)), "lw": 1.2}
_EVENT: Final = {"color": "0.4", "ls": ":", "lw": 1.1}
_FAN_LEVELS: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
_FAN_TIMES: Final = 60
_TITLE_WIDTH: Final = 105


def draw_course(course: Course, end_hours: float | None = None) -> Figure:
    """Return a figure of a prognosis over service hours, test cycles where no hours are known.

    Parameters
    ----------
    course
        Tests of a unit; at least one has a valid estimate.
    end_hours
        Service hour at which a fault truly reached its limit, if that is after the last test [h].
    """
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
    figure = Figure(figsize=(10.5, 1.2 + 1.15 * sum(heights)), layout="constrained")
    panels = list(
        figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    )
    end = _last_hour(course, place)
    _draw_lives(panels[0], course, place, true_remaining_life(course, end_hours))
    fan = _fan(course, end) if in_hours else None
    for axes, i in zip(panels[1:], shown, strict=False):
        _draw_fault(axes, course, place, truth, i, fan)
    if performance:
        _draw_requirement(panels[-1], course, place, performance)
    for axes in panels:
        axes.grid(color="0.5", alpha=0.2)
        axes.spines[["top", "right"]].set_visible(False)
        _mark_events(axes, course, place, is_named=axes is panels[0])
    panels[-1].set_xlabel(
        "service hours [h]" if in_hours else "test cycle (no service hours known)"
    )
    panels[-1].set_xlim(min(place[np.isfinite(place)].min(), end), end)
    panels[0].set_title(_title(course), loc="left", fontsize="medium")
    figure.align_ylabels(panels)
    figure.legend(handles=_legend(panels), loc="outside upper center", ncols=5, frameon=False)
    return figure


def _title(course: Course) -> str:
    unit, life = course.record.description, course.outlooks[-1].rul
    name = f"{unit.actuator_id} ({unit.serial_number}), {len(course.outlooks)} valid tests: "
    if not life.known:
        return f"{name}remaining useful life unknown\n{fill(f'({life.reason})', _TITLE_WIDTH)}"
    return (
        f"{name}{life.hours_50:.0f} h left ({life.hours_05:.0f} to {life.hours_95:.0f} h), "
        f"until {life.criterion}"
    )


def _is_shown(course: Course, truth: NDArray[np.float64], i: int) -> bool:
    """Return whether a fault is worth a panel: it ends life, gives a warning or truly moved."""
    name = FAULT_NAMES[i]
    if name not in COMPONENTS:
        return False
    last, limit = course.outlooks[-1], course.settings.limits.of(name)
    worst = max(last.health.faults, key=lambda item: item.share).name
    ends_life = last.rul_faults.known and last.lives[name].criterion == last.rul_faults.criterion
    moved = np.abs(truth[:, i] - FAULTS[i].healthy) > _MOVES * limit
    warns = _of(last.health.faults, name).level in (WARN, ERROR)
    return bool(name == worst or ends_life or warns or moved.any())


def _last_hour(course: Course, place: NDArray[np.float64]) -> float:
    """Return where the axis ends: behind the likely end of life, if that is not far away."""
    known = place[np.isfinite(place)]
    life = course.outlooks[-1].rul
    span = max(float(known.max() - known.min()), 1.0)
    ahead = min(1.1 * life.hours_95, 2.5 * life.hours_50, 2.0 * span) if life.known else 0.0
    return float(known.max()) + max(ahead, 0.06 * span)


def _fan(course: Course, end: float) -> Fan | None:
    tracker = course.growth.tracker
    # From the tracker's own hours: those of the last test may not be believed.
    ahead = end - tracker.hours
    if not tracker.updates or not ahead > 0.0:
        return None
    times = ahead * np.linspace(0.0, 1.0, _FAN_TIMES)
    return tracker.fan(times, _FAN_LEVELS, course.outlooks[-1].duty)


def _draw_lives(
    axes: Axes, course: Course, place: NDArray[np.float64], truth: NDArray[np.float64]
) -> None:
    lives = [outlook.rul for outlook in course.outlooks]
    low, median, high = (
        np.array([getattr(life, name) for life in lives])
        for name in ("hours_05", "hours_50", "hours_95")
    )
    known = np.array([life.known for life in lives])
    if np.isfinite(truth).any():
        cone = axes.fill_between(
            place, (1.0 - ALPHA) * truth, (1.0 + ALPHA) * truth, color=_CONE, alpha=0.3, lw=0
        )
        cone.set_label(f"truth ± {100 * ALPHA:.0f} %")
        axes.plot(place, truth, label="truth", **_TRUTH)
    # Early bands may reach to infinity, and would hide all else.
    top = np.nanmax([1.0, *(2.0 * truth if np.isfinite(truth).any() else 1.5 * median[known])])
    drawn_high = np.where(np.isinf(high), 10.0 * top, high)
    if known.any():
        band = axes.fill_between(
            place, low, drawn_high, where=known.tolist(), color=_PREDICTED, alpha=0.2, lw=0
        )
        band.set_label("predicted, 5 to 95 %")
        axes.plot(place, median, "o-", color=_PREDICTED, ms=3.5, lw=1.4, label="predicted, median")
    for kind, style, colour in (
        ("faults", "--", _BY_FAULTS),
        ("requirements", "-.", _BY_REQUIREMENTS),
    ):
        of_kind: list[RemainingLife] = [
            getattr(outlook, f"rul_{kind}") for outlook in course.outlooks
        ]
        if any(life.known for life in of_kind):
            medians = [life.hours_50 for life in of_kind]
            axes.plot(place, medians, style, color=colour, lw=1.2, label=f"median by {kind}")
    if not known.all():
        none = np.zeros(int((~known).sum()))
        axes.plot(place[~known], none, "|", color="0.45", ms=9, label="none told", clip_on=False)
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
    estimates = [step.estimate for step in course.steps if step.outlook is not None]
    value = np.array([one.faults[i] for one in estimates])
    sigma = np.nan_to_num(np.array([one.sigma[i] for one in estimates]))
    axes.errorbar(
        place,
        value,
        _SIGMAS_OF_90_PERCENT * sigma,
        fmt="o",
        ms=3,
        color="0.55",
        elinewidth=1.0,
        label="estimate, 90 %",
    )
    if np.isfinite(truth[:, i]).any():
        axes.plot(place, truth[:, i], label="truth", zorder=3, **_TRUTH)
    tracked = [_of(outlook.health.faults, fault.name).value for outlook in course.outlooks]
    axes.plot(place, tracked, "-", color=_PREDICTED, lw=1.6, label="tracked", zorder=4)
    if fan is not None:
        low, lower, median, upper, high = fan.values[fault.name]
        ahead = course.growth.tracker.hours + fan.hours
        axes.fill_between(ahead, low, high, color=_PREDICTED, alpha=0.15, lw=0, label="5 to 95 %")
        axes.fill_between(
            ahead, lower, upper, color=_PREDICTED, alpha=0.25, lw=0, label="25 to 75 %"
        )
        axes.plot(ahead, median, ":", color=_PREDICTED, lw=1.4, label="future median")
    limit = course.settings.limits.of(fault.name)
    ends = [fault.healthy + limit] + [fault.healthy - limit] * (fault.healthy > 0.0)
    for end in ends:
        axes.axhline(end, label="limit", **_LIMIT)
    _mark_life(axes, last.hours, last.lives[fault.name], _nearest(ends, tracked[-1]))
    least, most = min(*value, *tracked, *ends), max(*value, *tracked, *ends)
    least = min(least, fault.healthy)
    axes.set_ylim(least - 0.06 * (most - least), most + 0.12 * (most - least))
    axes.set_ylabel(fault.label)


def _draw_requirement(axes: Axes, course: Course, place: NDArray[np.float64], name: str) -> None:
    unit, scale = RequirementLimits.unit(name), 1.0
    unit, scale = SHOWN_IN.get(unit, (unit, scale))
    items = [_of(outlook.health.requirements, name) for outlook in course.outlooks]
    value = scale * np.array([item.value for item in items])
    sigma = scale * np.nan_to_num(np.array([item.sigma for item in items]))
    axes.errorbar(
        place,
        value,
        _SIGMAS_OF_90_PERCENT * sigma,
        fmt="s-",
        ms=3,
        color=_BY_REQUIREMENTS,
        lw=1.0,
        label="performance, 90 %",
    )
    limit, last = scale * items[-1].limit, course.outlooks[-1]
    axes.axhline(limit, label="limit", **_LIMIT)
    axes.text(
        0.006,
        limit,
        "fails below" if name in BELOW else "fails above",
        transform=axes.get_yaxis_transform(),
        va="top" if name in BELOW else "bottom",
        fontsize="small",
    )
    _mark_life(axes, last.hours, last.lives[name], limit)
    axes.margins(y=0.15)
    label = name.replace("_", " ")
    axes.set_ylabel(label if unit == "1" else f"{label}\n[{unit}]")


def _mark_life(axes: Axes, now: float, life: RemainingLife, level: float) -> None:
    """Draw when a limit is reached, 5 % to 95 %, on the limit."""
    if not life.known:
        return
    ends = now + np.array([life.hours_05, life.hours_50, life.hours_95])
    axes.plot(
        ends[[0, 2]], [level, level], "-", color="0.1", lw=3.0, solid_capstyle="butt", zorder=5
    )
    axes.plot(ends[1], level, "D", color="0.1", ms=5, label="end of life, 5 / 50 / 95 %", zorder=6)


def _mark_events(axes: Axes, course: Course, place: NDArray[np.float64], *, is_named: bool) -> None:
    marked = [
        (x, event)
        for x, outlook in zip(place, course.outlooks, strict=True)
        for event in (outlook.events if np.isfinite(x) else ())
        # Where tests are missing, no points are.
        if not event.startswith("missed tests")
    ]
    for number, (x, event) in enumerate(marked):
        axes.axvline(x, label="event", **_EVENT)
        if is_named:
            axes.annotate(
                event.partition(":")[0],
                (x, 0.98),
                xycoords=axes.get_xaxis_transform(),
                rotation=90,
                # An outlier and what it turns out to be at the next test stand side by side.
                ha="left" if number % 2 else "right",
                va="top",
                fontsize="x-small",
                color="0.3",
            )


def _legend(panels: list[Axes]) -> list[Artist]:
    handles: dict[str, Artist] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    return list(handles.values())


def _of(items: tuple[FaultHealth, ...], name: str) -> FaultHealth:
    return next(item for item in items if item.name == name)


def _nearest(ends: list[float], value: float) -> float:
    return min(ends, key=lambda end: abs(end - value))
