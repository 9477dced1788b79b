"""What a monitor shows of a drive whose controller is unknown (docs/identification.md, M40 to M46).

    python benchmarks/unknown_drive.py [--json FILE] [--quick] [--fast N] [--slow N]

At 1 kHz: friction, backlash and loss of torque per ampere under the thesis's chirp, of units of the
reference plant and of foreign ones (`foreign`), with and without a measured speed. Slow records of
25 to 100 Hz (`unknown_units`): whether three loads and five severities of each fault are ranked,
healthy units called healthy, and what a load hides said to be hidden.
"""

from itertools import pairwise
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from tables import target_table
from targets import Row, at_least, at_most
from trials import command, workers
from unknown_units import FastUnit, SlowUnit

from ema_core.levels import OK
from ema_monitor.calibrations import calibrate
from ema_monitor.diagnosis import identify
from ema_monitor.health import HealthLimits, assess
from ema_monitor.identification.estimate import Estimate

WITHIN: Final = 0.02
RANKED: Final = 0.95
HEALTHY: Final = 0.99
SHOWN: Final = ("friction", "backlash", "torque loss")
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


def fast_unit(task: tuple[int, bool, bool]) -> list[dict[str, Any]]:
    """Calibrate a unit and identify its tests; return truth and estimates."""
    seed, foreign, speed = task
    unit = FastUnit.of(seed, foreign=foreign, speed=speed)
    calibration = calibrate(
        [unit.window({}, {}, number) for number in range(_CALIBRATIONS)], unit.description
    )
    rng = np.random.default_rng((20, seed))
    rows = []
    for number in range(_TESTS):
        truth = dict(zip(SHOWN, rng.uniform(0.0, (0.8, 0.8, 0.3)).tolist(), strict=True))
        causes = {"torque_constant": -truth["torque loss"]}
        if number % 2:
            causes["load_torque"] = float(rng.uniform(-0.2, 0.2))
        faults = {name: truth[name] for name in SHOWN[:2]}
        window = unit.window(faults, causes, _CALIBRATIONS + number)
        estimate = identify(window, unit.description, calibration)
        rows.append({"truth": truth, "shown": shown(estimate), "verdict": estimate.verdict})
    return rows


def slow_unit(seed: int) -> dict[str, Any]:
    """Calibrate a slowly logged unit; return what its records are taken for."""
    unit = SlowUnit.of(seed)
    calibration = calibrate(
        [unit.record({}, {}, number) for number in range(_CALIBRATIONS)], unit.description
    )
    number = _CALIBRATIONS
    ranked, healthy, hidden = [], [], []
    for load in LOADS:
        causes = {"load_torque": load * unit.friction}
        for fault, severities in SEVERITIES.items():
            values = []
            for severity in severities:
                number += 1
                faults = {} if fault == "torque loss" else {fault: severity}
                loss = {"torque_constant": -severity} if fault == "torque loss" else {}
                window = unit.record(faults, causes | loss, number)
                estimate = identify(window, unit.description, calibration)
                values.append(shown(estimate)[fault][0])
                if fault == "backlash" and "backlash is hidden" in estimate.reason:
                    values[-1] = HIDDEN
            ranked.append(
                {"fault": fault, "load": load, "severities": severities, "values": values}
            )
        for _ in range(_HEALTHY_EACH):
            number += 1
            estimate = identify(unit.record({}, causes, number), unit.description, calibration)
            level = assess(estimate, HealthLimits()).level if estimate.valid else -1
            named = [one.name for one in estimate.causes]
            healthy.append(
                {
                    "ok": level == OK and not {"inertia", "current_gain"} & set(named),
                    "significant": [
                        name for name in SHOWN[:2] if getattr(estimate.faults, name) > 0.0
                    ],
                }
            )
        if load:
            number += 1
            faults = {"backlash": 0.3}
            window = unit.record(faults, causes, number, preloaded=True)
            estimate = identify(window, unit.description, calibration)
            said = "backlash is hidden" in estimate.reason
            hidden.append(bool(said and np.isnan(estimate.sigma.backlash)))
    return {
        "seed": seed,
        "rate_hz": 1.0 / unit.description.sample_period,
        "sampling": unit.description.acquisition.current,
        "ranked": ranked,
        "healthy": healthy,
        "hidden": hidden,
    }


def measure(progress: Progress, fast: int, slow: int) -> dict[str, Any]:
    """Print what is shown of drives whose controller is unknown, in so many units at each rate."""
    kinds = {
        "reference": (False, True),
        "reference, no speed": (False, False),
        "foreign": (True, True),
        "foreign, no speed": (True, False),
    }
    found: dict[str, Any] = {}
    with workers(progress) as pool:
        for name, (foreign, speed) in kinds.items():
            tasks = [(_FIRST_FAST + number, foreign, speed) for number in range(fast)]
            tests = [row for unit in pool.map(name, fast_unit, tasks) for row in unit]
            found[name] = {fault: _errors(tests, fault) for fault in SHOWN}
        seeds = [_FIRST_SLOW + number for number in range(slow)]
        return {"fast": found, "slow": pool.map("slow records", slow_unit, seeds)}


def _errors(rows: list[dict[str, Any]], fault: str) -> dict[str, float]:
    """Return how far estimates of a fault are off, and how well their intervals cover."""
    error = np.array([row["shown"][fault][0] - row["truth"][fault] for row in rows])
    sigma = np.array([row["shown"][fault][1] for row in rows])
    known = np.isfinite(error) & np.isfinite(sigma)
    size = np.abs(error[known])
    return {
        "estimates": len(rows),
        "known": int(known.sum()),
        "median": float(np.median(size)),
        "p90": float(np.quantile(size, 0.9)),
        "max": float(np.max(size)),
        "within": float(np.mean(size <= WITHIN)),
        "coverage": float(np.mean(size <= 1.645 * sigma[known])),
    }


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the targets."""
    result = []
    for name, by_fault in figures["fast"].items():
        for fault, one in by_fault.items():
            percent = 100.0 * (one["p90"] if one["known"] == one["estimates"] else np.inf)
            what = f"drive unknown, 1 kHz, {name}: {fault}, 90 % of errors [%]"
            measured = f"{percent:.2f} (largest {100.0 * one['max']:.2f})"
            result.append(at_most(what, percent, 100.0 * WITHIN, measured))
    sets = [one for unit in figures["slow"] for one in unit["ranked"]]
    shares = [
        (
            f"five severities of {fault} in order",
            [in_order(one["values"]) for one in sets if one["fault"] == fault],
            RANKED,
        )
        for fault in SHOWN
    ]
    healthy = [one["ok"] for unit in figures["slow"] for one in unit["healthy"]]
    hidden = [one for unit in figures["slow"] for one in unit["hidden"]]
    shares += [
        ("healthy called healthy", healthy, HEALTHY),
        ("backlash that a load hides said to be hidden", hidden, HEALTHY),
    ]
    for what, found, least in shares:
        percent = 100.0 * float(np.mean(found))
        measured = f"{percent:.1f} of {len(found)}"
        result.append(at_least(f"  slow records: {what} [%]", percent, 100.0 * least, measured))
    return result


def in_order(values: list[float]) -> bool:
    """Return whether values rise from each to the next; one that is unknown does not."""
    return bool(np.all(np.diff(values) > 0.0))


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(target_table("drive unknown", rows(figures), beside=""))
    table = Table("1 kHz", "fault", "known", "median %", "90 % %", "largest %", "covered %")
    for name, by_fault in figures["fast"].items():
        for fault, one in by_fault.items():
            errors = (f"{100.0 * one[key]:.2f}" for key in ("median", "p90", "max"))
            known = f"{one['known']} of {one['estimates']}"
            table.add_row(name, fault, known, *errors, f"{100.0 * one['coverage']:.0f}")
    console.print(table)
    table = Table("unit", "Hz", "current", "sets in order", "pairs in order", "healthy", "hidden")
    for unit in figures["slow"]:
        sets = [one["values"] for one in unit["ranked"]]
        pairs = [b > a for values in sets for a, b in pairwise(values)]
        table.add_row(
            str(unit["seed"]),
            f"{unit['rate_hz']:.0f}",
            unit["sampling"],
            f"{sum(map(in_order, sets))} of {len(sets)}",
            f"{sum(pairs)} of {len(pairs)}",
            f"{sum(one['ok'] for one in unit['healthy'])} of {len(unit['healthy'])}",
            f"{sum(unit['hidden'])} of {len(unit['hidden'])}",
        )
    console.print(table)


main = command(measure, show, quick={"fast": 5, "slow": 3}, fast=20, slow=12)

if __name__ == "__main__":
    main()
