# SPDX-License-Identifier: Apache-2.0
"""Report on the joints of a robot: levels, changes, and trend of friction."""

import math
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from ema_cli.bags.joint_course import JointCourse
from ema_cli.report.page import inline_svg, render
from ema_cli.show.joint_table import HEADINGS, friction_text, row_of
from ema_core.levels import ERROR, LEVEL_NAMES, STALE, WARN
from ema_core.wording import counted
from ema_monitor.joint import wording
from ema_monitor.plot.style import BLUE, GREY, stacked_panels, tidy
from ema_monitor.quantities import FRICTION

_URGENCY = {ERROR: 0, WARN: 1, STALE: 2}


def joints_page(title: str, courses: Sequence[JointCourse], command: str) -> str:
    """Return the report on a robot's joints, worst first, as self-contained HTML.

    Parameters
    ----------
    title
        Name of the recordings.
    courses
        Courses of the joints.
    command
        Command line that creates the report.
    """
    ordered = sorted(courses, key=lambda course: _URGENCY.get(course.level, 3))
    return render(
        "joints.html.j2",
        command,
        title=title,
        headings=HEADINGS,
        joints=[_joint(number, course) for number, course in enumerate(ordered)],
        summary=_summary(courses),
    )


def _joint(number: int, course: JointCourse) -> dict[str, object]:
    name, _, *cells = row_of(course)
    comparison = course.valid[-1].comparison if course.valid else None
    picture = None
    if len(course.valid) > 1:
        caption = (
            "Change of Coulomb friction of each record with its 90 % interval, in per cent of "
            "the healthy records."
        )
        figure = draw_friction(course)
        picture = Markup(inline_svg(figure, f"friction-{number}", f"Friction of {name}", caption))
    return {
        "name": name,
        "level": LEVEL_NAMES[course.level],
        "cells": cells,
        "reason": course.reason,
        "friction": friction_text(course.friction),
        "rows": list(wording.rows(comparison)) if comparison else [],
        "headings": wording.HEADINGS,
        "picture": picture,
        "remarks": course.remarks,
        "baseline": str(course.calibration) if course.calibration else course.why_no_baseline,
    }


def _summary(courses: Sequence[JointCourse]) -> str:
    counts = [
        f"{counted(number, 'joint')} {LEVEL_NAMES[level]}"
        for level in (ERROR, WARN, STALE, 0)
        if (number := sum(course.level == level for course in courses))
    ]
    return ", ".join(counts)


def draw_friction(course: JointCourse) -> Figure:
    """Return a figure of the change of friction over time, with 90 % intervals."""
    changes = [
        (estimate.end_ns, estimate.comparison[FRICTION])
        for estimate in course.valid
        if estimate.comparison is not None
    ]
    shown = [(end_ns, item) for end_ns, item in changes if math.isfinite(item.change)]
    figure, [axes] = stacked_panels([1.0], 2.6)
    percent = 100.0 * np.array([(item.change, item.low, item.high) for _, item in shown])
    change, low, high = percent.reshape(-1, 3).T
    if course.is_dated:
        times = np.array([end_ns for end_ns, _ in shown]).astype("datetime64[ns]")
        axes.set_xlabel("end of the record, UTC")
    else:
        first_ns = course.estimates[0].start_ns
        times = np.array([1e-9 * (end_ns - first_ns) / 60.0 for end_ns, _ in shown])
        axes.set_xlabel("time since the first compared record [min]")
    axes.axhline(0.0, color=GREY, lw=1.0)
    axes.errorbar(times, change, [change - low, high - change], fmt="o", ms=3, lw=1.0, color=BLUE)
    axes.set_ylabel("change of friction [%]")
    tidy(axes)
    if course.is_dated:
        figure.autofmt_xdate(rotation=20)
    return figure
