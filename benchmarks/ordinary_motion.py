"""What ordinary motion tells of the faults, without any test cycle.

    python benchmarks/ordinary_motion.py [--json FILE] [--quick] [--plants N]

Twenty seconds each of random smooth moves, ramps with dwells and sines, under a load of up to 30 %
of the torque limit, on the simulator's own actuator and on foreign ones (`foreign`). Each unit is
calibrated on healthy windows of the test cycle, or on healthy stretches of ordinary motion.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Final

import motion_cases
import numpy as np
from motion_cases import CALIBRATION_STRETCHES, MOTIONS, UNINFORMATIVE, Recording
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from tables import target_table
from targets import Row, all_of, at_least, at_most
from trials import ACTUATOR, Workers, command, difference, workers
from trust_cases import Kind, Task, Unit

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE, FAULT_NAMES, FAULTS, N_FAULTS
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.tally import CombinationSettings

RIGHT: Final = {"friction": 0.02, "backlash": 0.02, "gain": 0.02}
"""Error up to which a fault is right, 0.03 where it is not named [-]."""

RIGHT_OTHERWISE: Final = 0.03
WITHIN: Final = 0.95
SILENT: Final = 0.99
COVERAGE: Final = 0.85
WRONG_AND_CONFIDENT: Final = 1e-3
CALIBRATED_ON: Final = ("chirp", "motion", "chirp and motion")

_Z: Final = NormalDist().inv_cdf(0.95)
_CONFIDENT_SIGMA: Final = 3.0
_WRONG: Final = 0.02
_ASSESSED: Final = [n for n, fault in enumerate(FAULTS) if fault.limit is not None]
_KINDS: Final[tuple[tuple[str, Kind], ...]] = (("own", "own"), ("foreign", "foreign"))


@dataclass(frozen=True)
class Found:
    """What one recording gave, in plain values.

    Attributes
    ----------
    truth
        Fault vector, eight values.
    estimates
        Faults, standard deviations (NaN where unobservable), flags of what is unobservable, and
        verdict of each estimate.
    tally
        What became of the stretches.
    seconds
        Computing time [s].
    """

    truth: tuple[float, ...]
    estimates: tuple[tuple[tuple[float, ...], tuple[float, ...], tuple[bool, ...], str], ...]
    tally: dict[str, Any]
    seconds: float


def calibration_of(recording: Recording) -> Calibration:
    """Return the calibration of a recording's unit, on windows as the recording wants them."""
    windows = []
    if "chirp" in recording.calibrated_on:
        windows += [task.window() for task in Task(recording.unit, (0,)).healthy()]
    if "motion" in recording.calibrated_on:
        healthy = recording.healthy()
        each = CALIBRATION_STRETCHES // len(healthy)
        windows += [window for one in healthy for window in one.stretches()[:each]]
    return calibrate_model(windows, ACTUATOR)


def identified(work: tuple[Recording, Calibration]) -> Found:
    """Record a motion, and return what its stretches give."""
    recording, calibration = work
    stretches = recording.stretches()
    combination = Combination(ACTUATOR, calibration, settings=CombinationSettings(pause_s=0.0))
    started = time.perf_counter()
    found = [one for stretch in stretches for one in combination.add(stretch)]
    estimates = [one for one in found if isinstance(one, Estimate)] + combination.finish()
    seconds = time.perf_counter() - started
    return Found(
        recording.faults,
        tuple(
            (tuple(one.faults), tuple(one.sigma), tuple(one.unobservable.tolist()), one.verdict)
            for one in estimates
        ),
        combination.tally._asdict(),
        seconds,
    )


def accuracy(found: Sequence[Found]) -> dict[str, Any]:
    """Return the figures of the estimates of a condition."""
    made = [(one, *estimate) for one in found for estimate in one.estimates]
    used = [row for row in made if row[4] != "refused"]
    shape = (len(used), N_FAULTS)
    away = np.abs([difference(row[1], row[0].truth) for row in used]).reshape(shape)
    sigma = np.array([row[2] for row in used], dtype=float).reshape(shape)
    unknown = np.array([row[3] for row in used], dtype=bool).reshape(shape)
    size = away.copy()
    zeta = np.array([row[1][ECCENTRICITY] for row in used])
    size[:, ECCENTRICITY_PHASE] *= zeta
    wrong = (size > _WRONG) & (away > _CONFIDENT_SIGMA * sigma) & ~unknown
    stretches = sum(one.tally["stretches"] for one in found)
    return {
        "recordings": len(found),
        "without_estimate": sum(not one.estimates for one in found),
        "estimates": len(made),
        "verdicts": {
            name: sum(row[4] == name for row in made) for name in ("valid", "degraded", "refused")
        },
        "stretches": stretches,
        "searched": sum(one.tally["combined"] + one.tally["refused"] for one in found),
        "refused": sum(one.tally["refused"] for one in found),
        "seconds_per_stretch": sum(one.seconds for one in found) / max(1, stretches),
        "wrong_and_confident": _share(np.any(wrong, axis=1)),
        "coverage": _share((away <= _Z * sigma)[:, _ASSESSED][~unknown[:, _ASSESSED]]),
        "by_component": {
            FAULT_NAMES[n]: _of_component(n, away[:, n], sigma[:, n], unknown[:, n])
            for n in _ASSESSED
        },
    }


def _of_component(n: int, away: Any, sigma: Any, unknown: Any) -> dict[str, float]:
    known = away[~unknown]
    limit = RIGHT.get(FAULT_NAMES[n], RIGHT_OTHERWISE)
    return {
        "median": _quantile(known, 0.5),
        "p90": _quantile(known, 0.9),
        "unobservable": _share(unknown),
        "within_or_unobservable": _share(unknown | (away <= limit)),
        "coverage": _share(known <= _Z * sigma[~unknown]),
    }


def _share(flags: Any) -> float:
    """Return the share of those that hold; NaN of none."""
    return float(np.mean(flags)) if len(flags) else float("nan")


def _quantile(values: Any, share: float) -> float:
    return 100.0 * float(np.quantile(values, share)) if len(values) else float("nan")


def measure(progress: Progress, plants: int, recordings: int) -> dict[str, Any]:
    """Print what ordinary motion tells of the faults."""
    conditions = {
        f"{label}, {motion}, calibrated on the {calibrated_on}": motion_cases.faulty(
            kind, plants, motion, calibrated_on, recordings
        )
        for label, kind in _KINDS
        for calibrated_on in CALIBRATED_ON
        for motion in MOTIONS
    }
    silent = {
        f"{label}, {motion}": motion_cases.uninformative(kind, plants, motion, recordings)
        for label, kind in _KINDS
        for motion in UNINFORMATIVE
    }
    with workers(progress) as pool:
        units = {
            (one.unit, one.calibrated_on): one
            for chosen in (*conditions.values(), *silent.values())
            for one in chosen
        }
        made = pool.map("calibrations", calibration_of, list(units.values()))
        calibrations = dict(zip(units, made, strict=True))
        with_faults = _found(pool, "ordinary motion", conditions, calibrations)
        without = _found(pool, "uninformative motion", silent, calibrations)
    return {
        "sizes": {"plants": plants, "recordings": recordings},
        "faults": {name: accuracy(found) for name, found in with_faults.items()},
        "uninformative": {name: accuracy(found) for name, found in without.items()},
    }


def _found(
    pool: Workers,
    what: str,
    conditions: dict[str, list[Recording]],
    calibrations: dict[tuple[Unit, str], Calibration],
) -> dict[str, list[Found]]:
    work = [
        (one, calibrations[one.unit, one.calibrated_on])
        for recordings in conditions.values()
        for one in recordings
    ]
    found = iter(pool.map(what, identified, work))
    return {name: [next(found) for _ in recordings] for name, recordings in conditions.items()}


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the targets."""
    result = []
    for calibrated_on in CALIBRATED_ON:
        chosen = {
            name: one
            for name, one in figures["faults"].items()
            if name.endswith(f" the {calibrated_on}") and one["estimates"]
        }
        shares = {
            (name, component): by["within_or_unobservable"]
            for name, one in chosen.items()
            for component, by in one["by_component"].items()
        }
        worst = min(shares, key=lambda key: shares[key], default=("", ""))
        estimates = sum(one["estimates"] for one in chosen.values())
        wrong = sum(one["wrong_and_confident"] * one["estimates"] for one in chosen.values())
        wrong_percent = 100.0 * wrong / max(1, estimates)
        covered = [one["coverage"] for one in chosen.values()]
        result += [
            all_of(
                f"motion, calibrated on the {calibrated_on}: right or unobservable in 95 %",
                [share >= WITHIN for share in shares.values()],
                f"{100.0 * shares.get(worst, np.nan):.0f} % ({', '.join(worst)})",
            ),
            at_most(
                "  wrong and confident [%]",
                wrong_percent,
                100.0 * WRONG_AND_CONFIDENT,
                f"{wrong_percent:.1f} of {estimates}",
            ),
            all_of(
                "  90 % interval covers in 85 %, each motion",
                [share >= COVERAGE for share in covered],
                f"{100.0 * min(covered, default=np.nan):.0f} %",
            ),
        ]
    recordings = sum(one["recordings"] for one in figures["uninformative"].values())
    silent = sum(one["without_estimate"] for one in figures["uninformative"].values())
    share = 100.0 * silent / max(1, recordings)
    what = "uninformative motion: given no estimate [%]"
    return [*result, at_least(what, share, 100.0 * SILENT, f"{share:.1f} of {recordings}")]


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(target_table("ordinary motion", rows(figures), beside=""))
    table = Table(
        "motion",
        "record-\nings",
        "without\nestimate",
        "esti-\nmates",
        "valid",
        "degra-\nded",
        "re-\nfused",
        "stretches",
        "searched",
        "s a\nstretch",
        "wrong and\nconfident %",
        "interval\ncovers %",
    )
    for name, one in (figures["faults"] | figures["uninformative"]).items():
        table.add_row(
            name,
            *(str(one[key]) for key in ("recordings", "without_estimate", "estimates")),
            *(str(count) for count in one["verdicts"].values()),
            *(str(one[key]) for key in ("stretches", "searched")),
            f"{one['seconds_per_stretch']:.3f}",
            *(_percent(one[key]) for key in ("wrong_and_confident", "coverage")),
        )
    console.print(table)
    table = Table(
        "motion: error of what is known, median / 90 % [%]; unobservable; right or unobservable; "
        "covered [%]",
        *(FAULT_NAMES[n].replace("_", "\n") for n in _ASSESSED),
    )
    for name, one in figures["faults"].items():
        cells = [
            f"{by['median']:.1f} / {by['p90']:.1f}\n{_percent(by['unobservable'])}; "
            f"{_percent(by['within_or_unobservable'])}; {_percent(by['coverage'])}"
            for by in one["by_component"].values()
        ]
        table.add_row(name, *cells)
    console.print(table)


def _percent(share: float) -> str:
    return "" if share != share else f"{100.0 * share:.0f}"


main = command(measure, show, 160, quick={"plants": 3, "recordings": 3}, plants=6, recordings=12)

if __name__ == "__main__":
    main()
