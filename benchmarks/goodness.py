"""What the goodness of fit refuses: windows in which something else than the eight faults is wrong.

    python benchmarks/goodness.py [--json FILE]

Prints, for each defect and size, how large the goodness of fit is beside its limit, and the largest
fault that would have been named; then how many windows with faults alone are refused in error.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cases
import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from ema_core.description import ActuatorDescription
from ema_core.faults import ECCENTRICITY_PHASE, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identifying import identify

_NOMINAL: Final = ActuatorParameters()
_DESCRIPTION: Final = ActuatorDescription()


@dataclass(frozen=True)
class Defect:
    """Something wrong: a plant other than described, or a sensor that lies."""

    name: str
    plant: ActuatorParameters = _NOMINAL
    sensor: Callable[[Telemetry], Telemetry] = lambda telemetry: telemetry


def plant(name: str, *parameters: str, factor: float) -> Defect:
    """Return a defect that multiplies parameters of the plant."""
    return Defect(name, _NOMINAL.replace({p: factor * getattr(_NOMINAL, p) for p in parameters}))


def sensor(name: str, column: str, *, factor: float = 1.0, offset: float = 0.0) -> Defect:
    """Return a defect of a sensor."""
    return Defect(
        name,
        sensor=lambda telemetry: replace(
            telemetry, **{column: factor * getattr(telemetry, column) + offset}
        ),
    )


DEFECTS: Final = (
    Defect("none"),
    plant("inertia + 25 %", "J_m", "J_u", factor=1.25),
    plant("inertia + 50 %", "J_m", "J_u", factor=1.5),
    plant("viscous damping x 20", "C_m", "C_u", factor=20.0),
    plant("speed-loop gain + 20 %", "GAP", factor=1.2),
    plant("supply 24 V for 48 V", "V_max", factor=0.5),
    plant("torque constant - 10 %", "k_e", factor=0.9),
    sensor("current + 0.1 A", "current", offset=0.1),
    sensor("current + 0.5 A", "current", offset=0.5),
    sensor("current + 5 %", "current", factor=1.05),
    sensor("speed + 1 %", "speed", factor=1.01),
    sensor("speed + 5 %", "speed", factor=1.05),
)


def estimates(defect: Defect, calibration: Calibration, count: int) -> list[Estimate]:
    """Return estimates of noisy windows of an otherwise healthy actuator with a defect."""
    found = []
    for number in range(count):
        case = cases.Case(tuple(healthy_faults()), (number, 77), plant=defect.plant)
        window = case.window(defect.sensor(case.telemetry()), noisy=True)
        found.append(identify(window, _DESCRIPTION, calibration))
    return found


def summary(found: list[Estimate]) -> dict[str, Any]:
    """Return the figures of a table row."""
    offsets = np.array([np.abs(one.faults - healthy_faults()) for one in found])
    offsets[:, ECCENTRICITY_PHASE] = 0.0
    return {
        "goodness_of_fit": float(np.median([one.goodness_of_fit for one in found])),
        "limit": float(np.median([one.goodness_limit for one in found])),
        "refused": sum(not one.valid for one in found),
        "windows": len(found),
        "largest_fault": float(np.median(np.max(offsets, axis=1))),
    }


@click.command()
@click.option("--windows", "count", default=5, show_default=True, help="Windows a defect.")
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(count: int, output: Path | None) -> None:
    """Print the table and write the JSON file."""
    healthy = [
        case.window(case.telemetry(), noisy=True) for case in cases.healthy(12, "calibration")
    ]
    calibration = calibrate(healthy, _DESCRIPTION)
    progress = Console(stderr=True)
    results = {
        defect.name: summary(estimates(defect, calibration, count))
        for defect in track(DEFECTS, "defects", console=progress)
    }
    drawn = cases.validation(100)
    for name, faulty in (("faults by the law", drawn[:100]), ("wide", drawn[100:])):
        found = [
            identify(case.window(case.telemetry(), noisy=True), _DESCRIPTION, calibration)
            for case in track(faulty, name, console=progress)
        ]
        results[f"none, {name}"] = summary(found)
    table = Table("defect", "goodness of fit", "limit", "refused", "largest fault named")
    for name, one in results.items():
        table.add_row(
            name,
            f"{one['goodness_of_fit']:.1f}",
            f"{one['limit']:.1f}",
            f"{one['refused']} of {one['windows']}",
            f"{one['largest_fault']:.3f}",
        )
    Console(width=100).print(table)
    if output:
        output.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
