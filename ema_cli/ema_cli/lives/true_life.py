"""When a unit's life truly ended, by its true faults."""

import math

import numpy as np
from numpy.typing import NDArray

from ema_cli.bags.truths import truth_at
from ema_cli.bags.unit_course import Course
from ema_core.faults import FAULTS, N_FAULTS
from ema_monitor.prognosis.requirements.requirements import FITTED, REQUIREMENTS


def true_faults(course: Course) -> NDArray[np.float64]:
    """Return the true faults of each valid test, ``(n, 8)``; NaN where they are not recorded.

    Parameters
    ----------
    course
        Tests of a unit.
    """
    rows = []
    for step in course.steps:
        if step.outlook is not None:
            truth = truth_at(course.record.truths, step.estimate.start_ns)
            rows.append(np.full(N_FAULTS, np.nan) if truth is None else truth.faults)
    return np.reshape(rows, (-1, N_FAULTS))


def true_remaining_life(course: Course, end_hours: float | None = None) -> NDArray[np.float64]:
    """Return the hours left at each valid test until life truly ended [h], ``(n,)``.

    Life ends when a true fault reaches its limit, or a required performance, computed by the
    monitor's model from the true faults, fails: between two tests, where the share of the way to
    the limit passes 1 on a straight line. NaN where the hour or the end is not known.

    Parameters
    ----------
    course
        Tests of a unit.
    end_hours
        Service hour at which a fault reaches its limit, if that is after the last test [h].
    """
    hours = course.hours
    share = _share_of_the_way(course, true_faults(course))
    known = np.isfinite(hours) & np.isfinite(share)
    left = np.full(len(hours), np.nan)
    end = math.nan if end_hours is None else end_hours
    later = None
    # Backwards: what is left at a test is what is left until the next end after it.
    for i in np.flatnonzero(known)[::-1]:
        if share[i] >= 1.0:
            end = hours[i]
        elif later is not None and share[later] >= 1.0:
            part = (1.0 - share[i]) / (share[later] - share[i])
            end = hours[i] + part * (hours[later] - hours[i])
        left[i] = max(end - hours[i], 0.0)
        later = i
    return left


def _share_of_the_way(course: Course, faults: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest share of the way to a limit at each valid test, ``(n,)`` [-]."""
    limits = course.settings.limits
    shares = [
        abs(faults[:, number] - fault.healthy) / limits.of(fault.name)
        for number, fault in enumerate(FAULTS)
        if fault.limit is not None
    ]
    requirements = FITTED.of(course.parameters, course.settings.requirements)
    if not isinstance(requirements, str):
        shares += list(1.0 - requirements.exact_reserves(REQUIREMENTS, faults).T)
    return np.max(shares, axis=0)
