"""Error and time of the algorithms on the thesis's cases, through the command line.

    python tests/benchmarks/accuracy.py [--json FILE] [--algorithm NAME]...

Prints a table and writes JSON: per case and algorithm the error of the estimate in percent of the
range (equation M14), the evaluations and the computing time.
"""

import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from ema_core.faults import FAULT_NAMES, estimation_error, fault_vector

MULTIPLE: Final = (0.0068, 0.0, 9.19e-3, 0.0013, 8.6e-4, 0.0111, 0.627, 0.38038)
CASES: Final[dict[str, dict[str, float]]] = {
    "friction low": {"friction": 0.25},
    "friction high": {"friction": 0.75},
    "backlash low": {"backlash": 9 / 99},
    "backlash high": {"backlash": 74 / 99},
    "short circuit low": {"short_circuit_a": 0.2},
    "short circuit high": {"short_circuit_a": 0.7},
    "eccentricity low": {"eccentricity": 0.25},
    "eccentricity high": {"eccentricity": 0.75},
    "gain low": {"gain": 0.25},
    "gain high": {"gain": 0.75},
    "multiple": dict(zip(FAULT_NAMES, MULTIPLE, strict=True)),
}


def ema(*arguments: str) -> str:
    """Run the ema command and return what it prints."""
    return subprocess.run(["ema", *arguments], check=True, capture_output=True, text=True).stdout


def run_case(faults: dict[str, float], algorithm: str, folder: Path) -> dict[str, Any]:
    """Simulate a case if its bag is not there yet, estimate it and compare."""
    bag = folder / "case.mcap"
    if not bag.exists():
        pairs = [f"--fault={name}={value!r}" for name, value in faults.items()]
        ema("simulate", *pairs, "-o", str(bag))
    [estimate] = json.loads(ema("estimate", str(bag), "--algorithm", algorithm, "--json"))
    found = [estimate["faults"][name] for name in FAULT_NAMES]
    return {
        "error_percent": estimation_error(found, fault_vector(faults)),
        "evaluations": estimate["evaluations"],
        "computing_time_s": estimate["computing_time_s"],
        "faults": found,
    }


@click.command()
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--algorithm", "algorithms", multiple=True, default=["least_squares", "pso"])
def main(output: Path | None, algorithms: tuple[str, ...]) -> None:
    """Print the table and write the JSON file."""
    results: dict[str, dict[str, Any]] = {}
    console = Console(width=100)
    with tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(track(CASES, "cases", console=Console(stderr=True))):
            place = Path(folder) / str(number)
            place.mkdir()
            results[name] = {a: run_case(CASES[name], a, place) for a in algorithms}
    table = Table("case", expand=False)
    for algorithm in algorithms:
        for what in ("error %", "evaluations", "time s"):
            table.add_column(f"{algorithm}\n{what}", justify="right")
    for name, by_algorithm in results.items():
        cells = [
            cell
            for one in by_algorithm.values()
            for cell in (
                f"{one['error_percent']:.2f}",
                str(one["evaluations"]),
                f"{one['computing_time_s']:.2f}",
            )
        ]
        table.add_row(name, *cells)
    console.print(table)
    for algorithm in algorithms:
        errors = [by_algorithm[algorithm]["error_percent"] for by_algorithm in results.values()]
        console.print(f"{algorithm}: mean {np.mean(errors):.2f} %, worst {np.max(errors):.2f} %")
    if output:
        output.write_text(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
