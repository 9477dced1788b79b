"""Many windows simulated and identified on all cores, one process a core."""

import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import click
import numpy as np
from cases import Case
from numpy.typing import ArrayLike, NDArray
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)

from ema_core.description import ActuatorDescription
from ema_core.faults import ECCENTRICITY_PHASE, estimation_error
from ema_core.linear_algebra import one_thread
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.model.threads import limit_threads

ACTUATOR: Final = ActuatorDescription()
"""Description given to the monitor for every actuator, whatever the plant really is."""

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class Variant:
    """One way to look at a window.

    Attributes
    ----------
    calibration
        Calibration of the unit.
    noisy
        Whether the sensors have noise and a finite resolution.
    settings
        How to identify.
    """

    calibration: Calibration
    noisy: bool = False
    settings: SearchSettings = SearchSettings()  # noqa: RUF009 - frozen


class Job(NamedTuple):
    """A case and the ways to look at its window."""

    case: Case
    variants: Sequence[Variant]


def command(
    measure: Callable[..., dict[str, Any]],
    show: Callable[[Console, dict[str, Any]], None],
    width: int = 140,
    *,
    quick: Mapping[str, int] | None = None,
    full: Mapping[str, int] | None = None,
    **options: int,
) -> click.Command:
    """Return the command of a script: it measures with progress, prints, and writes a JSON file.

    ``measure`` is given the progress and the options by name, of those for ``--quick`` or
    ``--full`` where these are given.
    """

    def run(output: Path | None, **given: Any) -> None:
        chosen = dict(options)
        for name, sizes in (("quick", quick), ("full", full)):
            chosen |= (sizes or {}) if given.pop(name, False) else {}
        chosen |= {name: value for name, value in given.items() if value is not None}
        started = time.perf_counter()
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        with Progress(*columns, TimeElapsedColumn(), console=Console(stderr=True)) as progress:
            figures = measure(progress, **chosen)
        figures["duration_s"] = time.perf_counter() - started
        console = Console(width=width)
        show(console, figures)
        console.print(f"{figures['duration_s']:.0f} s in all")
        if output:
            output.write_text(json.dumps(figures, indent=1))

    file = click.Path(path_type=Path, dir_okay=False)
    output = click.Option(["--json", "output"], type=file, help="File to write.")
    parameters: list[click.Parameter] = [output]
    for name, sizes in (("quick", quick), ("full", full)):
        if sizes is not None:
            words = ", ".join(f"{key} {value}" for key, value in sizes.items())
            parameters.append(click.Option([f"--{name}"], is_flag=True, help=words))
    for name, value in options.items():
        flag: Any = {"is_flag": True} if isinstance(value, bool) else {"type": int}
        words = "" if isinstance(value, bool) else f"{value} when not given."
        parameters.append(
            click.Option([f"--{name.replace('_', '-')}"], default=None, help=words, **flag)
        )
    return click.Command(None, callback=run, params=parameters, help=measure.__doc__)


class Workers:
    """Processes that simulate and identify, with progress on a bar."""

    def __init__(self, pool: ProcessPoolExecutor, progress: Progress) -> None:
        self._pool = pool
        self._progress = progress

    def map(self, what: str, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """Return what ``work`` makes of each item."""
        chunk = max(1, min(8, len(items) // 8))
        results = self._pool.map(work, items, chunksize=chunk)
        return list(self._progress.track(results, total=len(items), description=what))

    def estimates(self, what: str, jobs: Sequence[Job]) -> list[list[Estimate]]:
        """Return the estimates of each job, one a variant; ``what`` is on the progress bar."""
        return self.map(what, _estimates, jobs)


@contextmanager
def workers(progress: Progress) -> Iterator[Workers]:
    """Start a process a core, each of which keeps to one thread."""
    os.environ.update(one_thread())
    # A fork would inherit threads of this process as they stand.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(
        os.cpu_count(), context, initializer=limit_threads, initargs=(1,)
    ) as pool:
        yield Workers(pool, progress)


def errors_percent(cases: Iterable[Case], estimates: Iterable[Estimate]) -> NDArray[np.float64]:
    """Return the error of each estimate in percent of the range; inf where there is none."""
    return np.array(
        [
            estimation_error(estimate.faults, case.faults)
            if np.all(np.isfinite(estimate.faults))
            else np.inf
            for case, estimate in zip(cases, estimates, strict=True)
        ]
    )


def difference(estimate: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Return estimate less truth by component, ``(8,)``, the phase wrapped to half a turn."""
    result = np.asarray(estimate, dtype=float) - np.asarray(truth, dtype=float)
    result[ECCENTRICITY_PHASE] -= np.round(result[ECCENTRICITY_PHASE])
    return result


def _estimates(job: Job) -> list[Estimate]:
    telemetry = job.case.telemetry()
    return [
        identify(
            job.case.window(telemetry, noisy=variant.noisy),
            ACTUATOR,
            variant.calibration,
            variant.settings,
        )
        for variant in job.variants
    ]
