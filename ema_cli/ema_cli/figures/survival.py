"""Picture of the share of units that live up to an age."""

import math

from matplotlib.figure import Figure

from ema_archive.fleet import FleetSummary
from ema_monitor.plot.style import BLUE, stacked_panels, tidy


def draw_survival(fleet: FleetSummary) -> Figure:
    """Return the curve of a fleet with its 90 % interval."""
    figure, [axes] = stacked_panels([1.0], 3.2)
    steps = [{"age": 0.0, "share": 1.0, "lower": 1.0, "upper": 1.0}, *fleet.survival]
    if fleet.longest_age > steps[-1]["age"]:
        steps.append({**steps[-1], "age": fleet.longest_age})
    ages = [step["age"] for step in steps]
    low, high = (
        [math.nan if step[name] is None else step[name] for step in steps]
        for name in ("lower", "upper")
    )
    axes.fill_between(ages, low, high, step="post", color=BLUE, alpha=0.2, lw=0, label="90 %")
    axes.step(ages, [step["share"] for step in steps], where="post", color=BLUE, label="share")
    axes.set_ylim(0.0, 1.02)
    axes.set_xlim(0.0, max(fleet.longest_age, 1.0))
    axes.set_xlabel("service hours since new or repaired [h]")
    axes.set_ylabel("share without failure")
    axes.legend(loc="lower left", frameon=False)
    tidy(axes)
    return figure
