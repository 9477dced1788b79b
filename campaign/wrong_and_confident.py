"""Estimates that are wrong and confident, over all conditions that can be injected.

The conditions, the judgement and its counter are those of ``benchmarks/trust.py``: foreign and own
actuators, faults with and without hidden causes, motions, periods, and hidden causes alone. To them
come faults of each sensor beside faults of the actuator. A case is one foreign unit, and some
windows of each condition; the held-out actuators are never used.
"""

import math
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from part import Case, Part

from ema_monitor.model.threads import limit_threads

UNITS: Final = 12
WINDOWS: Final = 3
"""Windows of each condition in a case."""

SENSOR_FAULTS: Final[Mapping[str, tuple[float, float]]] = {
    "current_offset": (-0.5, 0.5),
    "current_gain": (-0.1, 0.1),
    "speed_offset": (-3.0, 3.0),
    "speed_gain": (-0.05, 0.05),
    "position_offset": (-1e-3, 1e-3),
    "position_gain": (-0.05, 0.05),
    "current_delay": (0.0, 1e-3),
    "speed_delay": (0.0, 1e-3),
    "command_delay": (0.0, 1e-3),
}
"""Ranges of what is wrong with a sensor, in the units of ``ema_core.causes``."""

UNLIKELY: Final = 0.01
"""Probability below which so many wrong ones are not by chance within what is allowed."""

_BENCHMARKS: Final = Path(__file__).resolve().parents[1] / "benchmarks"
_FIRST_STREAM: Final = 300
_FOREIGN: Final = "foreign"


def run(case: Case) -> None:
    """Do a case; its steps are windows of each condition."""
    limit_threads(1)
    cases, scores = _benchmark("trust_cases"), _benchmark("trust_scores")
    calibrations: dict[Any, Any] = {}
    for name, tasks in conditions(case.number, case.steps or WINDOWS).items():
        for task in tasks:
            unit = task.unit, task.calibrated_on, task.sample_period
            if unit not in calibrations:
                calibrations[unit] = scores.calibrations(task)
            # A warm start begins near the faults that there were before: healthy ones have none.
            judged = scores.judged((task, calibrations[unit], task.faults != cases.HEALTHY))
            for start, one in zip(("cold", "warm"), judged, strict=False):
                _note(case, name, start, one, task)


def conditions(number: int, windows: int) -> dict[str, list[Any]]:
    """Return the tasks of a case by the names of their conditions.

    Parameters
    ----------
    number
        Of the case: it chooses the unit, and windows that no other case has.
    windows
        Of each condition.
    """
    trust, cases = _benchmark("trust"), _benchmark("trust_cases")
    unit, turn = number % UNITS, number // UNITS
    most = UNITS * windows * (turn + 1)
    sizes = trust.Sizes(UNITS, most, most, most)
    all_of: dict[str, list[Any]] = {
        one.name: one.tasks for one in trust.conditions(sizes, _FOREIGN)
    }
    for kind in (_FOREIGN, "own"):
        for name in cases.HIDDEN:
            all_of[f"{kind}, {name}"] = cases.hidden(kind, UNITS, name, most)
        for row, (name, extent) in enumerate(SENSOR_FAULTS.items()):
            all_of[f"{kind}, faults and {name.replace('_', ' ')}"] = cases.faulty(
                kind, UNITS, most, causes=_drawn(name, extent), stream=_FIRST_STREAM + row
            )
    first = unit + UNITS * windows * turn
    return {name: tasks[first::UNITS][:windows] for name, tasks in all_of.items()}


def judge(counts: Mapping[str, int]) -> list[str]:
    """Return whether more windows are wrong and confident than chance allows within the target."""
    trust = _benchmark("trust")
    lines = []
    for start in ("cold", "warm"):
        windows, wrong = counts.get(f"windows, {start}", 0), counts.get(_wrong(start), 0)
        if chance(wrong, windows, trust.WRONG_AND_CONFIDENT) < UNLIKELY:
            lines.append(
                f"{wrong} of {windows} windows are wrong and confident, {start} start: expected "
                f"{100.0 * trust.WRONG_AND_CONFIDENT:g} % at most"
            )
    return lines


def chance(wrong: int, windows: int, share: float) -> float:
    """Return the probability that of some windows so many are wrong, or more, by a share."""
    fewer = (
        math.comb(windows, n) * share**n * (1.0 - share) ** (windows - n) for n in range(wrong)
    )
    return 1.0 - sum(fewer)


def _note(case: Case, name: str, start: str, one: Any, task: Any) -> None:
    case.count(f"windows, {start}")
    case.count(f"refused, {start}", int(one.verdict == "refused"))
    case.count(_wrong(start), int(one.is_wrong_and_confident))
    if one.is_wrong_and_confident:
        print(f"wrong and confident, {start}: {name}: {task}")
        print(f"    truth {np.round(one.truth, 3)}, estimate {np.round(one.faults, 3)}")
        print(f"    sigma {np.round(one.sigma, 4)}, {one.verdict}: {one.reason}")


def _wrong(start: str) -> str:
    return f"wrong and confident, {start}"


def _drawn(
    name: str, extent: tuple[float, float]
) -> Callable[[np.random.Generator], dict[str, float]]:
    return lambda rng: {name: float(rng.uniform(*extent))}


def _benchmark(name: str) -> Any:
    """Return a module of the benchmarks, which are scripts beside each other."""
    if str(_BENCHMARKS) not in sys.path:
        sys.path.append(str(_BENCHMARKS))
    return import_module(name)


PART: Final = Part(
    "wrong_and_confident",
    "no more than 0.1 % of windows are off by 3 sigma and 2 %, whatever is injected",
    run,
    usual_s=150.0,
    limit_s=1200.0,
    share=1.0,
    judge=judge,
)
