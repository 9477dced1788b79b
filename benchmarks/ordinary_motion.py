# SPDX-License-Identifier: Apache-2.0
"""Accuracy of faults that are estimated from ordinary motion, without a test cycle.

    python benchmarks/ordinary_motion.py [--json FILE] [--quick] [--plants N]

The motions are random smooth moves, ramps with dwells, and sines, of twenty seconds each, under a
load of up to 30 % of the torque limit. The actuators are the simulator's own and foreign ones
(`foreign`). Each unit is calibrated on healthy windows of the test cycle, on healthy stretches of
ordinary motion, or on both.
"""

import time
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import plants as recorded
from plants import MOTIONS, UNINFORMATIVE, Kind, Recording, results_by_condition
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, all_of, grid, percent, share_at_least, share_at_most
from trials import ACTUATOR, Trial, mean, quantiles

from ema_core.faults import FAULTS
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.tally import CombinationSettings

RIGHT: Final = {"friction": 0.02, "backlash": 0.02, "gain": 0.02}
"""Largest error of a correct estimate by fault [-]; ``RIGHT_OTHERWISE`` for the other faults."""

RIGHT_OTHERWISE: Final = 0.03
WITHIN: Final = 0.95
SILENT: Final = 0.99
COVERAGE: Final = 0.85
WRONG_AND_CONFIDENT: Final = 1e-3
CALIBRATED_ON: Final = ("chirp", "motion", "chirp and motion")
KINDS: Final[tuple[Kind, ...]] = ("own", "foreign")

_ASSESSED: Final = [n for n, fault in enumerate(FAULTS) if fault.limit is not None]


class Result(NamedTuple):
    """Estimates of one recording, counts of its stretches by outcome, and computing time [s]."""

    estimates: list[Estimate]
    tally: dict[str, Any]
    seconds: float


def identified(work: tuple[Recording, Calibration]) -> Result:
    """Simulate a recording. Return the estimates from its stretches."""
    recording, calibration = work
    stretches = recording.stretches()
    combination = Combination(ACTUATOR, calibration, settings=CombinationSettings(pause_s=0.0))
    started = time.perf_counter()
    steps = [step for stretch in stretches for step in combination.add(stretch)]
    estimates = [step for step in steps if isinstance(step, Estimate)] + combination.finish()
    seconds = time.perf_counter() - started
    return Result(estimates, combination.tally._asdict(), seconds)


def accuracy(recordings: Sequence[Recording], results: Sequence[Result]) -> Figures:
    """Return errors, coverage and verdicts of the estimates in a condition."""
    pairs = [
        (r.faults, estimate)
        for r, f in zip(recordings, results, strict=True)
        for estimate in f.estimates
    ]
    trial = Trial.of((k for k, _ in pairs), [estimate for _, estimate in pairs])
    used, stretches = trial.used, sum(result.tally["stretches"] for result in results)
    by_component = {}
    for n in _ASSESSED:
        away, unknown = used.away[:, n], ~used.known[:, n]
        errors = quantiles(100.0 * away[~unknown])
        by_component[FAULTS[n].name] = {
            "median": errors["median"],
            "p90": errors["p90"],
            "unobservable": mean(unknown),
            "within_or_unobservable": mean(
                unknown | (away <= RIGHT.get(FAULTS[n].name, RIGHT_OTHERWISE))
            ),
            "coverage": used.coverage(columns=n),
        }
    return {
        "recordings": len(results),
        "without_estimate": sum(not result.estimates for result in results),
        "estimates": len(pairs),
        "verdicts": trial.verdicts(),
        "stretches": stretches,
        "searched": sum(result.tally["combined"] + result.tally["refused"] for result in results),
        "seconds_per_stretch": sum(result.seconds for result in results) / max(1, stretches),
        "wrong_and_confident": trial.wrong_and_confident(),
        "coverage": used.coverage(columns=_ASSESSED),
        "by_component": by_component,
    }


def measure(pool: Workers, plants: int, recordings: int) -> Figures:
    """Measure the accuracy of faults that are estimated from ordinary motion."""
    with_faults = {
        f"{kind}, {motion}, calibrated on the {on}": recorded.recordings(
            kind, plants, motion, on, recordings
        )
        for kind in KINDS
        for on in CALIBRATED_ON
        for motion in MOTIONS
    }
    silent = {
        f"{kind}, {motion}": recorded.recordings(kind, plants, motion, "chirp", recordings)
        for kind in KINDS
        for motion in UNINFORMATIVE
    }
    results = results_by_condition(pool, "ordinary motion", with_faults | silent, identified)
    return {
        name: {key: accuracy(chosen, results[key]) for key, chosen in conditions.items()}
        for name, conditions in (("faults", with_faults), ("uninformative", silent))
    }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    for on in CALIBRATED_ON:
        chosen = {
            name: fault
            for name, fault in figures["faults"].items()
            if name.endswith(f" the {on}") and fault["estimates"]
        }
        shares = {
            f"{name}, {component}": by["within_or_unobservable"]
            for name, entry in chosen.items()
            for component, by in entry["by_component"].items()
        }
        worst = min(shares, key=lambda key: shares[key], default="")
        estimates = sum(entry["estimates"] for entry in chosen.values())
        wrong = sum(entry["wrong_and_confident"] for entry in chosen.values())
        covered = [entry["coverage"] for entry in chosen.values()]
        yield all_of(
            f"motion, calibrated on the {on}: right or unobservable in 95 %",
            [share >= WITHIN for share in shares.values()],
            f"{percent(shares.get(worst, np.nan))} % ({worst})",
        )
        share = wrong / max(1, estimates)
        yield share_at_most("  wrong and confident", share, WRONG_AND_CONFIDENT, estimates)
        yield all_of(
            "  90 % interval covers in 85 %, each motion",
            [share >= COVERAGE for share in covered],
            f"{percent(min(covered, default=np.nan))} %",
        )
    silent = [
        number < entry["without_estimate"]
        for entry in figures["uninformative"].values()
        for number in range(entry["recordings"])
    ]
    yield share_at_least("uninformative motion: given no estimate", silent, SILENT)


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    counts = ("record-\nings", "without\nestimate", "esti-\nmates", "valid", "degra-\nded")
    more = ("re-\nfused", "stretches", "searched", "wrong and\nconfident")
    yield grid(
        "ordinary motion",
        ("motion", *counts, *more, "s a\nstretch", "interval\ncovers %"),
        (
            (
                name,
                *(entry[key] for key in ("recordings", "without_estimate", "estimates")),
                *entry["verdicts"].values(),
                *(entry[key] for key in ("stretches", "searched", "wrong_and_confident")),
                f"{entry['seconds_per_stretch']:.3f}",
                percent(entry["coverage"]),
            )
            for name, entry in (figures["faults"] | figures["uninformative"]).items()
        ),
    )
    yield grid(
        "error of what is known, median / 90 % [%]; unobservable; right or unobservable; covered",
        ("motion", *(FAULTS[n].name.replace("_", "\n") for n in _ASSESSED)),
        (
            (
                name,
                *(
                    f"{by['median']:.1f} / {by['p90']:.1f}\n{percent(by['unobservable'])}; "
                    f"{percent(by['within_or_unobservable'])}; {percent(by['coverage'])}"
                    for by in fault["by_component"].values()
                ),
            )
            for name, fault in figures["faults"].items()
        ),
    )


main = command(
    measure,
    "ordinary motion",
    rows,
    tables,
    width=160,
    quick={"plants": 3, "recordings": 3},
    plants=6,
    recordings=12,
)

if __name__ == "__main__":
    main()
