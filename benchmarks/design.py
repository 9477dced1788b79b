# SPDX-License-Identifier: Apache-2.0
"""Accuracy of the standard deviations promised for a test, and duration of designed tests.

    python benchmarks/design.py [--json FILE] [--quick]

Certifies tests of the simulator's own actuator and compares the promise with simulated tests.
Designs commands and compares them with the thesis's chirp. Runs the chirp and the designed command
on foreign actuators (`foreign`, effects for development), which are unknown to the design.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any, Final, NamedTuple

import numpy as np
from cases import CURRENT_NOISE, RESOLUTIONS
from numpy.typing import NDArray
from plants import Task, Unit, moderate_faults
from rich.table import Table
from script import Figures, Workers, command
from targets import Row, all_of, grid, percent, untargeted
from trials import Trial, Z, mean, median, quantiles

from ema_cli.rig_settings import RigSettings
from ema_cli.simulated_rig import SimulatedRig
from ema_core.commands import THESIS_CHIRP, Command
from ema_core.description import ActuatorDescription
from ema_core.faults import COMPONENTS, ECCENTRICITY_PHASE, FAULT_NAMES, healthy_faults
from ema_core.parameters import ActuatorParameters
from ema_monitor.calibration.fit import calibrate_model
from ema_monitor.design.designing import FINEST, design_command
from ema_monitor.design.information import Information
from ema_monitor.design.limits import MotionLimits
from ema_monitor.design.rehearsal import HALF_WIDTH, N_COMBINED, claimed, present, rehearse
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import Verdict
from ema_monitor.windows.window import Window
from ema_sim.bench import BenchSettings

RATIO: Final = 0.5
"""Largest duration of the designed command over the duration of the chirp [-]."""

_NOMINAL: Final = ActuatorParameters()
_SINE: Final = Command("sine", amplitude=0.01, start_frequency=4.0, duration=0.5)
_COARSE: Final = {"current": 0.05, "position": 1e-5, "speed": 1.0}
_CALIBRATION_WINDOWS: Final = 12
_MODERATE: Final[Mapping[str, float]] = {"travel": 0.03, "current": 15.0, "speed": 400.0}
_SEED: Final = 31_415


class Condition(NamedTuple):
    """A test to certify: command, sample period [s], noise [A] and resolutions of the sensors."""

    name: str
    command: Command
    sample_period: float = 1e-4
    current_noise: float = CURRENT_NOISE
    resolutions: Mapping[str, float] = RESOLUTIONS

    def rig(self) -> SimulatedRig:
        """Return a simulated rig that runs tests under this condition."""
        description = ActuatorDescription(sample_period=self.sample_period)
        settings = BenchSettings(current_noise=self.current_noise, seed=_SEED)
        bench = RigSettings(
            description, _NOMINAL, settings, dict(self.resolutions), THESIS_CHIRP, None, None
        )
        return SimulatedRig(bench, lambda: None)


def designed(within: tuple[str, Mapping[str, float]]) -> dict[str, Any]:
    """Return the command designed within named limits, and its comparison with the chirp."""
    name, limits = within
    rig = Condition(name, THESIS_CHIRP).rig()
    design = design_command(
        rig, ActuatorDescription(), MotionLimits.within(_NOMINAL, longest=0.5, **limits)
    )
    names = "shape", "amplitude", "duration", "start_frequency", "end_frequency", "final_fraction"
    return {
        "name": name,
        "command": {key: getattr(design.command, key) for key in names},
        "reached": design.reached,
        "ratio": design.command.duration / THESIS_CHIRP.duration,
        "wanted": dict(design.wanted),
        "sigma": {fault.name: fault.sigma for fault in design.rehearsed.faults},
        "error": {fault.name: fault.error for fault in design.rehearsed.faults},
    }


def chirp_demands() -> dict[str, float]:
    """Return the travel, current, torque and speed that the chirp reaches, as limits."""
    rig = Condition("chirp", THESIS_CHIRP).rig()
    windows = rig(THESIS_CHIRP, healthy_faults(), _CALIBRATION_WINDOWS, {})
    information = Information(calibrate_model(windows))
    demands = asdict(information.demands(information.windows(THESIS_CHIRP)))
    return {name: demands[name] for name in ("travel", "current", "torque", "speed")}


def certified(work: tuple[Condition, int]) -> dict[str, Any]:
    """Return the comparison of promised and simulated errors of each fault in a condition."""
    condition, repetitions = work
    rig, command = condition.rig(), condition.command
    description = ActuatorDescription(sample_period=condition.sample_period)
    promise = rehearse(rig, command, description)
    errors: dict[str, list[tuple[float, float, float]]] = {name: [] for name in COMPONENTS}
    for number, combination in enumerate(promise.combined):
        for window in rig(command, combination.faults, (repetitions + number) // N_COMBINED, {}):
            estimate = identify(window, description, promise.calibration)
            for i in set(claimed(estimate)).intersection(
                np.flatnonzero(present(combination.faults))
            ):
                error = estimate.faults[i] - combination.faults[i]
                errors[FAULT_NAMES[i]].append((combination.sigma[i], estimate.sigma[i], error))
    return {"name": condition.name, "faults": {name: _kept(of) for name, of in errors.items()}}


def _kept(tests: list[tuple[float, float, float]]) -> dict[str, float]:
    """Return promised over stated sigma, rms error and coverage of the 90 % interval.

    Each test is promised sigma, stated sigma and error of a fault. Without tests the result is
    empty.
    """
    if not tests:
        return {}
    values = np.array(tests)
    predicted, sigma, error = np.sqrt(np.mean(values**2, axis=0)).tolist()
    covers = float(np.mean(np.abs(values[:, 2]) <= HALF_WIDTH * values[:, 1]))
    return {"ratio": predicted / sigma, "error": error, "covers": covers}


def foreign(work: tuple[int, Command, int]) -> list[dict[str, Any]]:
    """Identify random faults of a foreign plant; ``work`` has its number, command and tests.

    Return for each test the verdict, the error [%] and, for each judged component, its sigma and
    whether its interval covers the truth.
    """
    number, command, tests = work
    unit = Unit("foreign", number)

    def window(faults: NDArray[np.float64], test: int) -> Window:
        seed = (_SEED, 2, number, test)
        return Task(unit, seed, tuple(faults.tolist()), motion=command).window()

    healthy = [window(healthy_faults(), i) for i in range(_CALIBRATION_WINDOWS)]
    calibration = calibrate_model(healthy)
    records = []
    for i in range(tests):
        faults = moderate_faults(np.random.default_rng([_SEED, 1, number, i]))
        estimate = identify(window(faults, _CALIBRATION_WINDOWS + i), calibration=calibration)
        trial = Trial.of([faults], [estimate])
        judged = ~estimate.insignificant & np.isfinite(trial.sigma[0])
        judged[ECCENTRICITY_PHASE] = False
        sigma = trial.sigma[0][judged]
        records.append(
            {
                "verdict": estimate.verdict,
                "error": float(trial.errors_percent[0]),
                "inside": (trial.away[0][judged] <= Z * sigma).tolist(),
                "sigma": sigma.tolist(),
            }
        )
    return records


def measure(pool: Workers, repetitions: int, plants: int, tests: int) -> Figures:
    """Design commands, compare promises with simulated tests, and test foreign plants."""
    within = [("moderate limits", _MODERATE), ("limits of the chirp itself", chirp_demands())]
    designs = pool.map("designs", designed, within)
    new = Command(**designs[0]["command"])
    conditions = [
        Condition("chirp, 10 kHz", THESIS_CHIRP),
        Condition("chirp, 1 kHz", THESIS_CHIRP, 1e-3),
        Condition("chirp, coarse and noisy", THESIS_CHIRP, 1e-4, 0.2, _COARSE),
        Condition("chirp, 1 kHz, coarse and noisy", THESIS_CHIRP, 1e-3, 0.2, _COARSE),
        Condition("sine, 10 kHz", _SINE),
        Condition("designed, 10 kHz", new),
        Condition("designed, coarse and noisy", new, 1e-4, 0.2, _COARSE),
    ]
    work = [(condition, repetitions) for condition in conditions]
    return {
        "designs": designs,
        "certificates": pool.map("certificates", certified, work),
        "foreign": {
            name: _scores(
                pool.map(f"foreign, {name}", foreign, [(n, command, tests) for n in range(plants)])
            )
            for name, command in (("chirp", THESIS_CHIRP), ("designed", new))
        },
    }


def _scores(of_plants: list[list[dict[str, Any]]]) -> Figures:
    every = [test for tests in of_plants for test in tests]
    return {
        "windows": len(every),
        "refused": sum(test["verdict"] == Verdict.REFUSED for test in every),
        **quantiles([test["error"] for test in every if np.isfinite(test["error"])]),
        "coverage": mean([flag for test in every for flag in test["inside"]]),
        "sigma": median([value for test in every for value in test["sigma"]]),
    }


def rows(figures: Figures) -> Iterator[Row]:
    """Yield the rows of the targets."""
    first, chirp_design = figures["designs"]
    ratios = {name: _of_chirp(first, name) for name in first["wanted"]}
    worst = max(ratios, key=lambda name: ratios[name])
    is_short = first["reached"] and first["ratio"] <= RATIO
    what = "designed command, duration over the chirp's"
    yield Row(what, f"<= {RATIO:g}", f"{first['ratio']:.2f}", is_short)
    what = "  its sigma over the chirp's, worst component"
    measured = f"{ratios[worst]:.2f} ({worst.replace('_', ' ')})"
    yield Row(what, "<= 1.1", measured, first["reached"])
    yield untargeted("  within the chirp's own demands", f"{chirp_design['ratio']:.2f}")
    shares = {
        f"{certificate['name']}, {name.replace('_', ' ')}": kept["ratio"]
        for certificate in figures["certificates"]
        for name, kept in certificate["faults"].items()
        if kept
    }
    # With few simulated tests there may be no sigma to compare with.
    worst = max(shares, key=lambda name: abs(np.log(shares[name])), default="")
    yield all_of(
        "predicted sigma within 25 % of simulated tests",
        [abs(ratio - 1.0) <= 0.25 for ratio in shares.values()],
        f"{shares[worst]:.2f} ({worst})" if worst else "none compared",
    )
    for name, scores in figures["foreign"].items():
        what = f"foreign plants, {name}: median, 90th percentile [%], coverage"
        measured = f"{scores['median']:.2f}, {scores['p90']:.2f}, {percent(scores['coverage'])} %"
        yield untargeted(what, measured)


def _of_chirp(design: dict[str, Any], name: str) -> float:
    """Return a fault's sigma over the larger of ``FINEST`` and its sigma under the chirp."""
    return design["sigma"][name] / max(design["wanted"][name] / 1.1, FINEST)


def tables(figures: Figures) -> Iterator[Table]:
    """Yield the tables to print below the targets."""
    names = [name.replace("_", "\n") for name in COMPONENTS]
    yield grid(
        "designs",
        ("sigma over the chirp's, error", *names, "duration\ns"),
        (
            (
                design["name"],
                *(
                    f"{_of_chirp(design, name):.2f}\n{design['error'][name]:.4f}"
                    if name in design["wanted"]
                    else ""
                    for name in COMPONENTS
                ),
                f"{design['command']['duration']:.3f}",
            )
            for design in figures["designs"]
        ),
    )
    yield grid(
        "certificates",
        ("predicted over stated sigma\n90 % interval covers %, error", *names),
        (
            (certificate["name"], *map(_certified, certificate["faults"].values()))
            for certificate in figures["certificates"]
        ),
    )


def _certified(ratios: dict[str, float]) -> str:
    return (
        f"{ratios['ratio']:.2f}\n{percent(ratios['covers'])}, {ratios['error']:.4f}"
        if ratios
        else "-\n-"
    )


main = command(
    measure,
    "design",
    rows,
    tables,
    quick={"repetitions": 60, "plants": 3, "tests": 8},
    repetitions=120,
    plants=6,
    tests=15,
)

if __name__ == "__main__":
    main()
