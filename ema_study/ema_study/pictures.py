"""Figures of the report with their captions."""

import base64
import io
from functools import cache
from typing import Final, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from ema_study.cases import MULTIPLE
from ema_study.figures_of_responses import (
    draw_calibration,
    draw_monitor,
    draw_monitor_step,
    draw_noise,
    draw_responses,
)
from ema_study.figures_of_runs import (
    COSTS,
    ERROR,
    ERRORS,
    TIME,
    draw_convergence,
    draw_estimates,
    draw_multiple_fault,
    draw_phases_of_gwo,
    draw_single_faults,
)
from ema_study.sources import MODEL_LABELS, counted, present_sources, single_fault_runs
from ema_study.style import FAULT_NAMES

# Of the thesis, by fault: under the step, under the chirp, and beside the monitor.
_THESIS_FIGURES: Final = {
    "friction": ("4.3 to 4.5", "4.7 to 4.9", "4.10"),
    "backlash": ("4.14 and 4.15", "4.16 to 4.18", "4.19"),
    "short_circuit": ("4.22 to 4.24", "4.26 to 4.28", "4.29"),
    "eccentricity": ("4.35 to 4.37", "4.38 and 4.39", "4.40"),
    "gain": ("4.43", "4.44 to 4.46", "4.47"),
}


class Picture(NamedTuple):
    """A figure as a PNG, its file name without ending, and its caption."""

    name: str
    caption: str
    png: bytes

    @property
    def uri(self) -> str:
        """The PNG as a data URI."""
        return "data:image/png;base64," + base64.b64encode(self.png).decode("ascii")


def pictures_of_runs(runs: pd.DataFrame) -> dict[str, list[Picture]]:
    """Return the pictures of the runs of all sources by section of the report."""
    single, every = single_fault_runs(runs), counted(runs)
    of_single = _run_numbers(single)
    of_multiple = _run_numbers(every[every["fault"] == MULTIPLE])
    convergence = []
    for model, label in MODEL_LABELS.items():
        of_model = every[every["model"] == model]
        if of_model.empty:
            continue
        sizes = of_model.groupby(["algorithm", "fault", "level"]).size()
        lines = (
            ", a single run of each algorithm on each fault."
            if sizes.max() == 1
            else f": median over the {_range(sizes)} runs of each algorithm on each fault."
        )
        costs = (
            f"Lowest cost after each generation with the {label}{lines} A run that has stopped "
            "keeps its last value. The axis of generations is logarithmic beyond 20."
        )
        errors = f"Error of the best point after each generation with the {label}{lines}"
        convergence += [
            _picture(f"costs_{model}", costs, draw_convergence(of_model, model, COSTS)),
            _picture(
                f"courses_of_errors_{model}", errors, draw_convergence(of_model, model, ERRORS)
            ),
        ]
    errors = (
        "Mean error of each algorithm on each single fault (figure 7.1). "
        f"{of_single} Each row has its own scale."
    )
    times = f"Mean time of a run (figure 7.2), logarithmic. {of_single}"
    multiple = f"Mean error and time on the multiple fault (tables 56 and 57). {of_multiple}"
    estimates = f"Estimate of the faulty component, a dot a run. {of_single}"
    phases = (
        "GWO's estimates of k7, the direction of the eccentricity, in all faults. In the thesis's "
        "code the leaders start at exactly 0."
    )
    return {
        "errors": [
            _picture("errors", errors, draw_single_faults(runs, ERROR)),
            _picture("times", times, draw_single_faults(runs, TIME)),
            _picture("multiple_fault", multiple, draw_multiple_fault(runs)),
        ],
        "convergence": convergence,
        "estimates": [
            _picture("estimates", estimates, draw_estimates(runs)),
            _picture("phases_of_gwo", phases, draw_phases_of_gwo(runs)),
        ],
    }


@cache
def pictures_of_chapter_4() -> dict[str, list[Picture]]:
    """Return the pictures of responses by section of the report; no run changes them."""
    noise = (
        "Current under the chirp with white noise on the reference current, its gain K above each "
        "row (figure 4.50); the noise is held for 1 µs, its seed is fixed."
    )
    calibration = (
        "Differences between the models on the healthy actuator, which the calibration removes "
        "(figure 6.4). Differences are shown without the ripple above 1 kHz."
    )
    step = (
        "Reference and monitor under the step, for which the monitors are not calibrated "
        "(figure 4.6)."
    )
    responses, monitor = [], [_picture("calibration", calibration, draw_calibration())]
    for fault, (*numbers, of_monitor) in _THESIS_FIGURES.items():
        for command, number in zip(("step", "chirp"), numbers, strict=True):
            caption = (
                f"{FAULT_NAMES[fault].capitalize()}, {command} (figures {number}). Right: a "
                "stretch enlarged."
            )
            figure = draw_responses(fault, command)
            responses.append(_picture(f"{fault}_{command}", caption, figure))
        caption = f"Reference and monitor, {FAULT_NAMES[fault]} (figure {of_monitor})."
        monitor.append(_picture(f"{fault}_monitor", caption, draw_monitor(fault)))
    monitor.append(_picture("step_monitor", step, draw_monitor_step()))
    return {
        "responses": responses,
        "noise": [_picture("noise", noise, draw_noise())],
        "monitor": monitor,
    }


def _run_numbers(runs: pd.DataFrame) -> str:
    sizes = runs.groupby(["source", "algorithm", "fault", "level"]).size()
    counts = "; ".join(
        f"{label} {_range(sizes.xs(label, level='source'))}" for label in present_sources(runs)
    )
    return f"Runs of each algorithm on each fault: {counts or 'none'}."


def _range(sizes: "pd.Series[int]") -> str:
    low, high = int(sizes.min()), int(sizes.max())
    return str(low) if low == high else f"{low} to {high}"


def _picture(name: str, caption: str, figure: Figure) -> Picture:
    with io.BytesIO() as file:
        figure.savefig(file, format="png", dpi=150)
        return Picture(name, caption, file.getvalue())
