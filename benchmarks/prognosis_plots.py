"""Pictures of the prognosis, from the figures that prognosis.py wrote.

    python benchmarks/prognosis_plots.py [--json FILE] [--output FOLDER]

Relative accuracy against the share of life, by method; and of one life of each kind of fault, that
of median accuracy with the law unknown, the remaining life against the truth and the growth with
its limit and what was foreseen of it.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from prognosis_estimates import drawn
from prognosis_lives import LIMITS, ScoredLife, growing
from prognosis_metrics import ALPHA
from prognosis_predictors import PREDICTORS, SETTINGS, Predictions
from prognosis_scores import SHARES

from ema_core.faults import FAULT_NAMES, FAULTS, healthy_faults
from ema_monitor.health import HealthLimits
from ema_monitor.plot.style import BLUE, ORANGE, VERMILION, draw_estimates, tidy
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.prediction import Fan
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_sim.lives import SimulatedLife

HERE: Final = Path(__file__).parent

FORESEEN_FROM: Final = 0.6
"""Share of the life from which on the growth is shown as it was foreseen [-]."""

# Of the palette of Okabe and Ito, which colour-blind people tell apart.
_COLOURS: Final = {
    "law known": "#009e73",
    "law unknown": BLUE,
    "linear trend": "#cc79a7",
    "progpy": VERMILION,
    "oracle": "0.35",
}
_LINES: Final = {"linear trend": "-.", "oracle": ":"}
_BANDS: Final = tuple(SETTINGS)
_CONE: Final = ORANGE
_TRUTH: Final = {"color": "0.1", "lw": 1.5, "ls": (0, (6, 2))}
_FAN_LEVELS: Final = (0.05, 0.25, 0.5, 0.75, 0.95)
_FAN_TIMES: Final = 60
_LOWEST_ACCURACY: Final = -1.0


@dataclass(frozen=True, eq=False)
class ShownLife:
    """A life, its measurements, and what was predicted after each."""

    scored: ScoredLife
    life: SimulatedLife
    measurements: Sequence[Measurement]
    predictions: Mapping[str, Predictions]

    @classmethod
    def of(cls, scored: ScoredLife) -> "ShownLife":
        """Predict a life by every method."""
        life = scored.life()
        measurements = drawn(scored, life)
        made = {name: predict(life, measurements) for name, predict in PREDICTORS.items()}
        return cls(scored, life, measurements, made)

    def fan(self, case: str) -> Fan:
        """Return how the growth is foreseen, up to a little beyond the end of life."""
        tracker = Tracker(HealthLimits(), SETTINGS[case])
        for measurement in self.measurements:
            if measurement.hours <= FORESEEN_FROM * self.life.end_hours:
                tracker.update(measurement)
        ahead_hours = 1.1 * self.life.end_hours - tracker.hours
        fan = tracker.fan(ahead_hours * np.linspace(0.0, 1.0, _FAN_TIMES), _FAN_LEVELS)
        return Fan(tracker.hours + fan.hours, fan.levels, fan.values)


def of_median_accuracy(figures: Mapping[str, Any]) -> list[ScoredLife]:
    """Return the life of each kind that the tracker predicts as well as half of them."""
    by_kind: dict[str, list[tuple[float, int]]] = {}
    for score in figures["drawn_lives"]["law unknown"]:
        by_kind.setdefault(score["kind"], []).append((score["cra"], score["number"]))
    numbers = [sorted(scores)[len(scores) // 2][1] for scores in by_kind.values()]
    return [growing(number + 1)[number] for number in numbers]


def lives_figure(lives: Sequence[ShownLife]) -> Figure:
    """Draw remaining life and growth of lives, one a row."""
    figure = Figure((12.5, 3.0 * len(lives)), layout="constrained")
    rows = figure.subplots(len(lives), 2, squeeze=False)
    for (left, right), shown in zip(rows, lives, strict=True):
        _draw_remaining(left, shown)
        _draw_growth(right, shown)
        for axes in (left, right):
            axes.set_xlim(0.0, 1.1 * shown.life.end_hours)
            tidy(axes)
    rows[0, 0].set_title("remaining useful life", fontsize="medium")
    rows[0, 1].set_title(
        f"growth, and as foreseen at {100 * FORESEEN_FROM:.0f} % of life",
        fontsize="medium",
    )
    for axes in rows[-1]:
        axes.set_xlabel("service hours [h]")
    figure.align_ylabels(rows[:, 0])
    figure.align_ylabels(rows[:, 1])
    handles = _legend(list(rows.flat))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
    return figure


def _draw_remaining(axes: Axes, shown: ShownLife) -> None:
    end = shown.life.end_hours
    hours = np.array([0.0, end])
    truth = end - hours
    low, high = (1.0 - ALPHA) * truth, (1.0 + ALPHA) * truth
    label = f"truth ± {100 * ALPHA:.0f} %"
    axes.fill_between(hours, low, high, color=_CONE, alpha=0.3, lw=0, label=label)
    axes.plot(hours, truth, label="truth", zorder=5, **_TRUTH)
    top = 1.7 * end
    for name, made in shown.predictions.items():
        colour = _COLOURS[name]
        if name in _BANDS:
            # A band may reach to infinity.
            low, high = made.low, np.minimum(made.high, 10.0 * top)
            band = axes.fill_between(made.hours, low, high, color=colour, alpha=0.15, lw=0)
            band.set_label(f"{name}, 5 to 95 %")
        style = _LINES.get(name, "-")
        axes.plot(made.hours, made.median, style, color=colour, lw=1.5, label=name)
    axes.set_ylim(0.0, top)
    axes.set_ylabel(f"{shown.scored.kind.replace('_', ' ')}\nremaining life [h]")


def _draw_growth(axes: Axes, shown: ShownLife) -> None:
    life = shown.life
    number = FAULT_NAMES.index(life.dominant)
    hours = np.array([measurement.hours for measurement in shown.measurements])
    value = np.array([measurement.faults[number] for measurement in shown.measurements])
    variance = np.array([measurement.variance[number] for measurement in shown.measurements])
    seen = np.isfinite(variance)
    draw_estimates(
        axes,
        hours[seen],
        value[seen],
        np.sqrt(variance[seen]),
        fmt="o",
        ms=2.5,
        color="0.6",
        elinewidth=0.8,
        label="estimate, 90 %",
    )
    axes.plot(life.hours, life.faults[:, number], label="truth", zorder=4, **_TRUTH)
    for case in _BANDS:
        fan = shown.fan(case)
        low, lower, median, upper, high = fan.values[life.dominant]
        colour = _COLOURS[case]
        axes.fill_between(fan.hours, low, high, color=colour, alpha=0.15, lw=0)
        middle = axes.fill_between(fan.hours, lower, upper, color=colour, alpha=0.2, lw=0)
        middle.set_label(f"{case}, 25 to 75 %")
        axes.plot(fan.hours, median, color=colour, lw=1.5)
    healthy = float(healthy_faults()[number])
    side = np.sign(life.faults[-1, number] - healthy)
    limit = healthy + side * LIMITS[life.dominant]
    axes.axhline(limit, color=VERMILION, ls=(0, (4, 3)), lw=1.2, label="limit")
    axes.axvline(life.end_hours, color="0.4", ls=":", lw=1.1, label="end of life")
    bottom, top = sorted((healthy, limit))
    room = 0.15 * (top - bottom)
    axes.set_ylim(bottom - room, top + 2.0 * room if side > 0.0 else top + room)
    axes.set_ylabel(FAULTS[number].label)


def accuracy_figure(lives: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Draw the relative accuracy against the share of life, a panel a method.

    Parameters
    ----------
    lives
        Scores of the lives, by method.
    """
    figure = Figure((12.0, 6.8), layout="constrained")
    panels = list(figure.subplots(2, 3, sharex=True, sharey=True).flat)
    percent = 100.0 * np.array(SHARES)
    of_each = {
        name: np.quantile([one["accuracy_by_share"] for one in scores], (0.05, 0.5, 0.95), axis=0)
        for name, scores in lives.items()
    }
    for axes, (name, (low, median, high)) in zip(panels, of_each.items(), strict=False):
        colour = _COLOURS[name]
        axes.fill_between(percent, low, high, color=colour, alpha=0.2, lw=0)
        axes.plot(percent, median, color=colour, lw=1.8)
        axes.axhline(1.0 - ALPHA, color=_CONE, ls=(0, (4, 3)), lw=1.2)
        axes.set_title(name, fontsize="medium")
    for name, (_, median, _) in of_each.items():
        panels[-1].plot(
            percent, median, _LINES.get(name, "-"), color=_COLOURS[name], lw=1.8, label=name
        )
    marks = [
        Line2D([], [], color="0.35", lw=1.8, label="median"),
        Patch(color="0.35", alpha=0.2, lw=0, label="5 to 95 % of lives"),
        Line2D([], [], color=_CONE, ls=(0, (4, 3)), lw=1.2, label=f"{1.0 - ALPHA:g}"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=3, frameon=False)
    panels[-1].set_title("medians", fontsize="medium")
    panels[-1].legend(loc="lower right", frameon=False)
    for axes in panels:
        tidy(axes)
    panels[0].set_ylim(_LOWEST_ACCURACY, 1.02)
    panels[0].set_xlim(percent[0], percent[-1])
    for axes in panels[3:]:
        axes.set_xlabel("share of life [%]")
    for axes in panels[::3]:
        axes.set_ylabel("relative accuracy [-]")
    count = len(next(iter(lives.values())))
    figure.suptitle(
        f"Relative accuracy of the remaining life over {count} lives; no prediction counts 0",
        fontsize="medium",
    )
    return figure


def _legend(panels: Sequence[Axes]) -> list[Artist]:
    handles: dict[str, Artist] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    return list(handles.values())


@click.command()
@click.option("--json", "source", type=click.Path(path_type=Path, exists=True))
@click.option("--output", type=click.Path(path_type=Path, file_okay=False))
def main(source: Path | None, output: Path | None) -> None:
    """Write the pictures."""
    folder = output or HERE / "report"
    folder.mkdir(parents=True, exist_ok=True)
    figures = json.loads((source or HERE / "prognosis.json").read_text())
    pictures = {
        "prognosis_accuracy": accuracy_figure(figures["drawn_lives"]),
        "prognosis_lives": lives_figure([ShownLife.of(one) for one in of_median_accuracy(figures)]),
    }
    for name, figure in pictures.items():
        figure.savefig(folder / f"{name}.png", dpi=120)
        click.echo(folder / f"{name}.png")


if __name__ == "__main__":
    main()
