"""Whether a test shows what was promised before it, and how short a designed one is.

    python benchmarks/design.py [--json FILE] [--quick]

Certifies tests of the simulator's own actuator and compares the promise with simulated tests;
designs commands and compares them with the thesis's chirp; runs chirp and designed command on
foreign actuators (`foreign`, effects for development), which the design knows nothing of.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np
from cases import CURRENT_NOISE, RESOLUTIONS
from foreign.effects import DEVELOPMENT, draw_plant
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from tables import target_table
from targets import Row, all_of, untargeted
from trials import Workers, command, difference, workers
from trust_cases import moderate_faults

from ema_cli.bench import Bench
from ema_cli.rehearsal import Rehearsal
from ema_core.commands import THESIS_CHIRP, Command, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS, FAULT_NAMES, estimation_error, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.design.certificate import certify
from ema_monitor.design.designing import FINEST, design_command
from ema_monitor.design.information import Information
from ema_monitor.design.limits import MotionLimits
from ema_monitor.diagnosis import identify
from ema_monitor.windows.trigger import TriggerSettings, WindowTrigger
from ema_monitor.windows.window import Window
from ema_sim.bench import BenchSettings

RATIO: Final = 0.5
"""Largest duration of the designed command over that of the chirp."""

WITHIN: Final = 0.25
"""How far a prediction may be from what simulated tests give."""

_NOMINAL: Final = ActuatorParameters()
_SINE: Final = Command("sine", amplitude=0.01, start_frequency=4.0, duration=0.5)
_COARSE: Final = {"current": 0.05, "position": 1e-5, "speed": 1.0}
_CALIBRATION_WINDOWS: Final = 12
_STIR: Final = 1.2e-5
_MODERATE: Final[Mapping[str, float]] = {"travel": 0.03, "current": 15.0, "speed": 400.0}
_SEED: Final = 31_415


@dataclass(frozen=True)
class Condition:
    """A test to certify: command, sample period [s], noise [A] and resolutions of the sensors."""

    name: str
    command: Command
    sample_period: float = 1e-4
    current_noise: float = CURRENT_NOISE
    resolutions: Mapping[str, float] = field(default_factory=lambda: RESOLUTIONS)

    def recorder(self) -> Rehearsal:
        """Return what records its windows."""
        description = ActuatorDescription(sample_period=self.sample_period)
        settings = BenchSettings(current_noise=self.current_noise, seed=_SEED)
        given = Bench(
            description, _NOMINAL, settings, dict(self.resolutions), THESIS_CHIRP, None, None
        )
        return Rehearsal(given, lambda: None)


def designed(within: tuple[str, Mapping[str, float]]) -> dict[str, Any]:
    """Return the command designed within limits, and how it compares with the chirp."""
    name, limits = within
    record = Condition(name, THESIS_CHIRP).recorder()
    started = time.perf_counter()
    found = design_command(
        record, ActuatorDescription(), MotionLimits.within(_NOMINAL, longest=0.5, **limits)
    )
    command = {
        key: getattr(found.command, key)
        for key in ("shape", "amplitude", "duration", "start_frequency", "end_frequency")
    }
    return {
        "name": name,
        "limits": dict(limits),
        "command": command | {"final_fraction": found.command.final_fraction},
        "reached": found.reached,
        "ratio": found.command.duration / THESIS_CHIRP.duration,
        "verdict": found.verdict,
        "demands": asdict(found.demands),
        "wanted": dict(found.wanted),
        "sigma": {one.name: one.sigma for one in found.rehearsed.faults},
        "error": {one.name: one.error for one in found.rehearsed.faults},
        "seconds": time.perf_counter() - started,
    }


def chirp_demands(_: None = None) -> dict[str, float]:
    """Return what the chirp itself demands, as limits."""
    record = Condition("chirp", THESIS_CHIRP).recorder()
    windows = record(THESIS_CHIRP, healthy_faults(), _CALIBRATION_WINDOWS, {})
    information = Information(calibrate_model(windows))
    demands = asdict(information.demands(information.windows(THESIS_CHIRP)))
    return {name: demands[name] for name in ("travel", "current", "torque", "speed")}


def certified(work: tuple[Condition, int]) -> dict[str, Any]:
    """Return what was promised of a test, and what simulated ones gave."""
    condition, repetitions = work
    certificate = certify(
        condition.recorder(),
        condition.command,
        ActuatorDescription(sample_period=condition.sample_period),
        repetitions=repetitions,
    )
    return {"name": condition.name} | certificate.record()


def foreign(work: tuple[int, str, Command, int]) -> list[dict[str, Any]]:
    """Return estimates of random faults of one foreign plant under a command."""
    number, name, command, tests = work
    healthy = [
        _foreign_window(number, command, healthy_faults(), i) for i in range(_CALIBRATION_WINDOWS)
    ]
    calibration = calibrate_model(healthy)
    records = []
    for i in range(tests):
        faults = moderate_faults(np.random.default_rng([_SEED, 1, number, i]))
        window = _foreign_window(number, command, faults, _CALIBRATION_WINDOWS + i)
        estimate = identify(window, calibration=calibration)
        away = difference(estimate.faults, faults)
        judged = ~estimate.insignificant & np.isfinite(np.array(estimate.sigma))
        judged[FAULT_NAMES.index("eccentricity_phase")] = False
        records.append(
            {
                "command": name,
                "verdict": estimate.verdict,
                "error": estimation_error(estimate.faults, faults),
                "inside": (np.abs(away) <= 1.645 * np.array(estimate.sigma))[judged].tolist(),
                "sigma": np.array(estimate.sigma)[judged].tolist(),
            }
        )
    return records


def _foreign_window(
    number: int, command: Command, faults: NDArray[np.float64], test: int
) -> Window:
    h = 1e-4
    rng = np.random.default_rng([_SEED, 2, number, test])
    cycle = build_cycle(command, h)
    below = int(np.argmin(cycle.samples[: cycle.start]))
    stir = cycle.samples[below] + _STIR * rng.standard_normal(round(rng.uniform(5e-3, 40e-3) / h))
    # A window begins once the command has left its threshold, so it ends a little after it.
    end = cycle.stop + round(0.02 / h)
    telemetry = draw_plant(number, DEVELOPMENT).telemetry(
        np.concatenate([stir, cycle.samples[below:end]]), faults, {}, rng, h
    )
    settings = TriggerSettings(window_s=(cycle.stop - cycle.start - 1) * h)
    [window] = WindowTrigger(_NOMINAL, settings).feed(telemetry)
    if not isinstance(window, Window):
        raise RuntimeError(f"foreign plant {number}, test {test}: {window}")
    return window


def measure(progress: Progress, repetitions: int, plants: int, tests: int) -> dict[str, Any]:
    """Print promises beside simulated tests of each condition, and tests of foreign plants."""
    with workers(progress) as pool:
        within = [("moderate limits", _MODERATE), ("limits of the chirp itself", chirp_demands())]
        designs = pool.map("designs", designed, within)
        designed_command = Command(**designs[0]["command"])
        conditions = [
            Condition("chirp, 10 kHz", THESIS_CHIRP),
            Condition("chirp, 1 kHz", THESIS_CHIRP, 1e-3),
            Condition("chirp, coarse and noisy", THESIS_CHIRP, 1e-4, 0.2, _COARSE),
            Condition("chirp, 1 kHz, coarse and noisy", THESIS_CHIRP, 1e-3, 0.2, _COARSE),
            Condition("sine, 10 kHz", _SINE),
            Condition("designed, 10 kHz", designed_command),
            Condition("designed, coarse and noisy", designed_command, 1e-4, 0.2, _COARSE),
        ]
        certificates = pool.map(
            "certificates", certified, [(one, repetitions) for one in conditions]
        )
        outside = _outside(pool, designed_command, plants, tests)
    return {
        "designs": designs,
        "certificates": certificates,
        "foreign": outside,
    }


def _outside(pool: Workers, command: Command, plants: int, tests: int) -> dict[str, dict[str, Any]]:
    """Return the scores of chirp and designed command on foreign plants."""
    commands = {"chirp": THESIS_CHIRP, "designed": command}
    work = [
        (number, name, one, tests) for number in range(plants) for name, one in commands.items()
    ]
    rows = [row for rows in pool.map("foreign plants", foreign, work) for row in rows]
    scores = {}
    for name in commands:
        mine = [row for row in rows if row["command"] == name]
        errors = [row["error"] for row in mine if np.isfinite(row["error"])]
        inside = [value for row in mine for value in row["inside"]]
        scores[name] = {
            "windows": len(mine),
            "refused": sum(row["verdict"] == "refused" for row in mine),
            "median": float(np.median(errors)),
            "p90": float(np.quantile(errors, 0.9)),
            "coverage": float(np.mean(inside)),
            "sigma": float(np.median([value for row in mine for value in row["sigma"]])),
        }
    return scores


def rows(figures: dict[str, Any]) -> list[Row]:
    """Return the rows of the targets."""
    first, own = figures["designs"]
    ratios = {name: _of_chirp(first, name) for name in first["wanted"]}
    worst = max(ratios, key=lambda name: ratios[name])
    result = [
        Row(
            "designed command, duration over the chirp's",
            f"<= {RATIO:g}",
            f"{first['ratio']:.2f}",
            first["reached"] and first["ratio"] <= RATIO,
        ),
        Row(
            "  its sigma over the chirp's, worst component",
            "<= 1.1",
            f"{ratios[worst]:.2f} ({worst.replace('_', ' ')})",
            first["reached"],
        ),
        untargeted("  within the chirp's own demands", f"{own['ratio']:.2f}"),
    ]
    shares = _predictions(figures)
    name = max(shares, key=lambda key: abs(np.log(shares[key])))
    result.append(
        all_of(
            "predicted sigma within 25 % of simulated tests",
            [abs(ratio - 1.0) <= WITHIN for ratio in shares.values()],
            f"{shares[name]:.2f} ({name})",
        )
    )
    for name, one in figures["foreign"].items():
        result.append(
            untargeted(
                f"foreign plants, {name}: median, 90th percentile [%], coverage",
                f"{one['median']:.2f}, {one['p90']:.2f}, {100.0 * one['coverage']:.0f} %",
            )
        )
    return result


def _of_chirp(design: dict[str, Any], name: str) -> float:
    """Return the standard deviation over that of the chirp, or over the finest that is wanted."""
    return design["sigma"][name] / max(design["wanted"][name] / 1.1, FINEST)


def _predictions(figures: dict[str, Any]) -> dict[str, float]:
    """Return predicted over stated sigma, by condition and component."""
    return {
        f"{certificate['name']}, {one['name'].replace('_', ' ')}": one["predicted_sigma"]
        / one["sigma"]
        for certificate in figures["certificates"]
        for one in certificate["repeated"]
        if one["sigma"] and one["predicted_sigma"]
    }


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(target_table("design", rows(figures), beside=""))
    table = Table("sigma over the chirp's, error", *map(_label, COMPONENTS), "duration\ns")
    for one in figures["designs"]:
        cells = [
            f"{_of_chirp(one, name):.2f}\n{one['error'][name]:.4f}" if name in one["wanted"] else ""
            for name in COMPONENTS
        ]
        table.add_row(one["name"], *cells, f"{one['command']['duration']:.3f}")
    console.print(table)
    table = Table("predicted over stated sigma", *map(_label, COMPONENTS))
    for certificate in figures["certificates"]:
        ratios = [
            f"{one['predicted_sigma'] / one['sigma']:.2f}" if one["sigma"] else "-"
            for one in certificate["repeated"]
        ]
        table.add_row(certificate["name"], *ratios)
    console.print(table)
    table = Table("90 % interval covers %, error", *map(_label, COMPONENTS))
    for certificate in figures["certificates"]:
        cells = [
            f"{100.0 * one['covers']:.0f}\n{one['error']:.4f}" if one["covers"] is not None else "-"
            for one in certificate["repeated"]
        ]
        table.add_row(certificate["name"], *cells)
    console.print(table)


def _label(name: str) -> str:
    return name.replace("_", "\n")


main = command(
    measure,
    show,
    quick={"repetitions": 60, "plants": 3, "tests": 8},
    repetitions=120,
    plants=6,
    tests=15,
)

if __name__ == "__main__":
    main()
