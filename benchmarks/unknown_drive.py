"""What a monitor shows of a drive whose controller is unknown (docs/identification.md, M40 to M46).

    python benchmarks/unknown_drive.py [--json FILE] [--quick] [--fast N] [--slow N]

At 1 kHz: friction, backlash and loss of torque per ampere under the thesis's chirp, of units of the
reference plant and of foreign ones (`foreign`), with and without a measured speed. Slow records of
25 to 100 Hz (`unknown_units`): whether three loads and five severities of each fault are ranked,
healthy units called healthy, and what a load hides said to be hidden.
"""

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy as np
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, at_most, grid, percent, share_at_least
from trials import Z, mean, quantiles
from unknown_units import FastUnit, SlowUnit

from ema_core.levels import OK
from ema_monitor.calibrations import calibrate
from ema_monitor.diagnosis import identify
from ema_monitor.health import HealthLimits, assess
from ema_monitor.identification.estimate import Estimate

WITHIN: Final = 0.02
RANKED: Final = 0.95
HEALTHY: Final = 0.99
SHOWN: Final[tuple[str, ...]] = ("friction", "backlash", "torque loss")
LOADS: Final = (0.0, 0.6, -0.6)
"""Constant load over the dry friction [-]."""

SEVERITIES: Final = {
    "friction": (0.1, 0.2, 0.35, 0.5, 0.7),
    "backlash": (0.1, 0.2, 0.35, 0.5, 0.7),
    "torque loss": (0.08, 0.16, 0.24, 0.32, 0.4),
}
HIDDEN: Final = -1.0
"""Stands for a backlash that the load is said to hide, which ranks below all that are shown."""

_TESTS: Final = 6
_CALIBRATIONS: Final = 5
_HEALTHY_EACH: Final = 3
_FIRST_FAST: Final = 5100
_FIRST_SLOW: Final = 6100


def shown(estimate: Estimate) -> dict[str, tuple[float, float]]:
    """Return value and sigma of what is shown; NaN where it is not."""
    nan = float("nan")
    found = {
        name: (float(getattr(estimate.faults, name)), float(getattr(estimate.sigma, name)))
        for name in SHOWN[:2]
    }
    loss = next((one for one in estimate.causes if one.name == "torque_constant"), None)
    return found | {"torque loss": (-loss.value, loss.sigma) if loss else (nan, nan)}


def conditions(severity: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the faults and the hidden causes of what is shown."""
    faults = {name: severity[name] for name in SHOWN[:2] if name in severity}
    is_weak = "torque loss" in severity
    return faults, {"torque_constant": -severity["torque loss"]} if is_weak else {}


def fast_unit(seed: int, *, foreign: bool, speed: bool) -> list[Figures]:
    """Calibrate a unit and identify its tests; return truth and estimates."""
    unit = FastUnit(seed, foreign, speed)
    healthy = [unit.window({}, {}, number) for number in range(_CALIBRATIONS)]
    calibration = calibrate(healthy, unit.description)
    rng, found = np.random.default_rng((20, seed)), []
    for number in range(_TESTS):
        truth: dict[str, float] = dict(
            zip(SHOWN, rng.uniform(0.0, (0.8, 0.8, 0.3)).tolist(), strict=True)
        )
        faults, causes = conditions(truth)
        if number % 2:
            causes["load_torque"] = float(rng.uniform(-0.2, 0.2))
        window = unit.window(faults, causes, _CALIBRATIONS + number)
        estimate = identify(window, unit.description, calibration)
        found.append({"truth": truth, "shown": shown(estimate)})
    return found


def slow_unit(seed: int) -> Figures:
    """Calibrate a slowly logged unit; return what its records are taken for."""
    unit = SlowUnit(seed)
    healthy = [unit.record({}, {}, number) for number in range(_CALIBRATIONS)]
    calibration = calibrate(healthy, unit.description)
    number = _CALIBRATIONS

    def estimate(severity: Mapping[str, float], load: float, *, preloaded: bool = False) -> Any:
        nonlocal number
        number += 1
        faults, causes = conditions(severity)
        causes = {"load_torque": load * unit.friction} | causes
        window = unit.record(faults, causes, number, preloaded=preloaded)
        return identify(window, unit.description, calibration)

    figures: Figures = {
        "seed": seed,
        "rate_hz": 1.0 / unit.description.sample_period,
        "sampling": unit.description.acquisition.current,
        "ranked": {fault: [] for fault in SHOWN},
        "healthy": [],
        "hidden": [],
    }
    for load in LOADS:
        for fault, severities in SEVERITIES.items():
            values = []
            for severity in severities:
                found = estimate({fault: severity}, load)
                is_hidden = fault == "backlash" and "backlash is hidden" in found.reason
                values.append(HIDDEN if is_hidden else shown(found)[fault][0])
            figures["ranked"][fault].append(values)
        for _ in range(_HEALTHY_EACH):
            found = estimate({}, load)
            is_ok = found.valid and assess(found, HealthLimits()).level == OK
            named = {one.name for one in found.causes}
            figures["healthy"].append(is_ok and not {"inertia", "current_gain"} & named)
        if load:
            found = estimate({"backlash": 0.3}, load, preloaded=True)
            is_hidden = "backlash is hidden" in found.reason
            figures["hidden"].append(bool(is_hidden and np.isnan(found.sigma.backlash)))
    return figures


def measure(pool: Workers, fast: int, slow: int) -> Figures:
    """Print what is shown of drives whose controller is unknown, in so many units at each rate."""
    kinds = {
        "reference": partial(fast_unit, foreign=False, speed=True),
        "reference, no speed": partial(fast_unit, foreign=False, speed=False),
        "foreign": partial(fast_unit, foreign=True, speed=True),
        "foreign, no speed": partial(fast_unit, foreign=True, speed=False),
    }
    found: Figures = {}
    for name, work in kinds.items():
        units = pool.map(name, work, range(_FIRST_FAST, _FIRST_FAST + fast))
        tests = [one for unit in units for one in unit]
        found[name] = {fault: errors(tests, fault) for fault in SHOWN}
    seeds = range(_FIRST_SLOW, _FIRST_SLOW + slow)
    return {"fast": found, "slow": pool.map("slow records", slow_unit, seeds)}


def errors(tests: list[Figures], fault: str) -> dict[str, float]:
    """Return how far estimates of a fault are off, and how well their intervals cover."""
    error = np.array([one["shown"][fault][0] - one["truth"][fault] for one in tests])
    sigma = np.array([one["shown"][fault][1] for one in tests])
    known = np.isfinite(error) & np.isfinite(sigma)
    size = np.abs(error[known])
    return {
        "estimates": len(tests),
        "known": int(known.sum()),
        **quantiles(100.0 * size),
        "coverage": mean(size <= Z * sigma[known]),
    }


def in_order(values: list[float]) -> bool:
    """Return whether values rise from each to the next; one that is unknown does not."""
    return bool(np.all(np.diff(values) > 0.0))


def rows(figures: Figures) -> Iterator[Row]:
    """Return the rows of the targets."""
    for name, by_fault in figures["fast"].items():
        for fault, one in by_fault.items():
            value = one["p90"] if one["known"] == one["estimates"] else np.inf
            what = f"drive unknown, 1 kHz, {name}: {fault}, 90 % of errors [%]"
            measured = f"{value:.2f} (largest {one['max']:.2f})"
            yield at_most(what, value, 100.0 * WITHIN, measured)
    units = figures["slow"]
    for fault in SHOWN:
        ordered = [in_order(values) for unit in units for values in unit["ranked"][fault]]
        what = f"  slow records: five severities of {fault} in order"
        yield share_at_least(what, ordered, RANKED)
    for key, what in (
        ("healthy", "healthy called healthy"),
        ("hidden", "backlash that a load hides said to be hidden"),
    ):
        flags = [one for unit in units for one in unit[key]]
        yield share_at_least(f"  slow records: {what}", flags, HEALTHY)


def tables(figures: Figures) -> Iterator[Table]:
    """Return what is printed below the targets."""
    yield grid(
        "at 1 kHz",
        ("units", "fault", "known", "median %", "90 % %", "largest %", "covered %"),
        (
            (
                name,
                fault,
                f"{one['known']} of {one['estimates']}",
                *(f"{one[key]:.2f}" for key in ("median", "p90", "max")),
                percent(one["coverage"]),
            )
            for name, by_fault in figures["fast"].items()
            for fault, one in by_fault.items()
        ),
    )
    yield grid(
        "slow records",
        ("unit", "Hz", "current", "sets in order", "pairs in order", "healthy", "hidden"),
        map(_slow_cells, figures["slow"]),
    )


def _slow_cells(unit: Figures) -> list[str]:
    sets = [values for some in unit["ranked"].values() for values in some]
    flags = (
        [in_order(values) for values in sets],
        [b > a for values in sets for a, b in pairwise(values)],
        unit["healthy"],
        unit["hidden"],
    )
    counts = (f"{sum(some)} of {len(some)}" for some in flags)
    return [unit["seed"], f"{unit['rate_hz']:.0f}", unit["sampling"], *counts]


QUICK: Final = {"fast": 5, "slow": 3}
main = command(measure, "drive unknown", rows, tables, quick=QUICK, fast=20, slow=12)

if __name__ == "__main__":
    main()
