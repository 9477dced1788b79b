"""Ordinary motion to be recorded: units, motions, faults and loads, by seeds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from trust_cases import HEALTHY, Kind, Unit, load, moderate_faults, telemetry_of, units

from ema_core.telemetry import Telemetry
from ema_monitor.api import find_windows
from ema_monitor.windows.trigger import ANY_MOTION, TriggerSettings
from ema_monitor.windows.window import Window

SECONDS: Final = 20.0
"""Length of a recording [s]."""

CALIBRATION_STRETCHES: Final = 24
"""Healthy stretches of ordinary motion that a unit is calibrated on, of all motions alike."""

_ROOT: Final = 41_507
_REACH: Final = 8e-3
_H: Final = 1e-4


def _moves(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return smooth moves between random angles, with dwells."""
    return _between(rng, t, (0.02, 0.3), 0.05, (0.0, 0.3), smooth=True)


def _ramps(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ramps between random angles, with dwells."""
    return _between(rng, t, (0.01, 0.1), 0.02, (0.05, 0.5), smooth=False)


def _sine(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a sine of random frequency and amplitude."""
    f = rng.uniform(0.5, 5.0)
    amplitude = min(rng.uniform(2e-3, _REACH), 0.4 / (2.0 * np.pi * f))
    return amplitude * np.sin(2.0 * np.pi * f * t)


def _between(
    rng: np.random.Generator,
    t: NDArray[np.float64],
    speeds: tuple[float, float],
    shortest_s: float,
    dwells: tuple[float, float],
    *,
    smooth: bool,
) -> NDArray[np.float64]:
    parts, at, count = [np.zeros(round(0.05 / _H))], 0.0, 0
    while count < len(t):
        to = float(rng.uniform(-_REACH, _REACH))
        share = np.pi / 2.0 if smooth else 1.0
        steps = round(max(share * abs(to - at) / rng.uniform(*speeds), shortest_s) / _H)
        u = np.arange(1, steps + 1) / steps
        parts.append(at + (to - at) * ((1.0 - np.cos(np.pi * u)) / 2.0 if smooth else u))
        parts.append(np.full(round(rng.uniform(*dwells) / _H), to))
        at, count = to, sum(map(len, parts))
    return np.concatenate(parts)[: len(t)]


def _rest(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rest at an angle."""
    return np.full(len(t), rng.uniform(-_REACH, _REACH))


def _tiny(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a sine of less than the least travel."""
    return rng.uniform(1e-4, 4e-4) * np.sin(2.0 * np.pi * rng.uniform(0.5, 5.0) * t)


def _drift(rng: np.random.Generator, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a slow trim one way."""
    return rng.choice([-1.0, 1.0]) * rng.uniform(1e-4, 1.5e-3) * t


MOTIONS: Final[Mapping[str, Callable[..., NDArray[np.float64]]]] = {
    "moves": _moves,
    "ramps": _ramps,
    "sine": _sine,
}
"""Ordinary motions: each maps random numbers and times [s] to a command [rad]."""

UNINFORMATIVE: Final[Mapping[str, Callable[..., NDArray[np.float64]]]] = {
    "rest": _rest,
    "tiny sine": _tiny,
    "drift": _drift,
}
"""Motions that do not show the faults."""


@dataclass(frozen=True)
class Recording:
    """Telemetry of ordinary motion to be recorded.

    Attributes
    ----------
    unit
        What it is recorded on.
    seed
        Seed of everything random in it.
    motion
        One of ``MOTIONS`` or ``UNINFORMATIVE``.
    faults
        Fault vector, eight values.
    causes
        Hidden causes by name, in the units of the registry.
    calibrated_on
        "chirp", the test cycle, "motion", or "chirp and motion".
    """

    unit: Unit
    seed: tuple[int, ...]
    motion: str
    faults: tuple[float, ...] = HEALTHY
    causes: Mapping[str, float] = field(default_factory=dict)
    calibrated_on: str = "chirp"

    def telemetry(self) -> Telemetry:
        """Record it."""
        rng = np.random.default_rng(self.seed)
        t = _H * np.arange(1.0, round(SECONDS / _H) + 1)
        commands = {**MOTIONS, **UNINFORMATIVE}[self.motion](rng, t)
        return telemetry_of(self.unit, commands, self.faults, self.causes, rng, _H)

    def stretches(self) -> list[Window]:
        """Record it, and return its stretches."""
        return find_windows(self.telemetry(), settings=TriggerSettings(windows=ANY_MOTION))

    def healthy(self) -> list["Recording"]:
        """Return recordings of the healthy unit in all motions, for its calibration."""
        return [
            replace(self, seed=_seed(0, self.unit, i), motion=motion, faults=HEALTHY, causes={})
            for i, motion in enumerate(MOTIONS)
        ]


def faulty(kind: Kind, plants: int, motion: str, calibrated_on: str, count: int) -> list[Recording]:
    """Return recordings with one to three faults and a load of up to 30 % of the torque limit."""
    return _recordings(kind, plants, motion, calibrated_on, count, stream=1)


def uninformative(kind: Kind, plants: int, motion: str, count: int) -> list[Recording]:
    """Return recordings of faulty units in motions that do not show it."""
    return _recordings(kind, plants, motion, "chirp", count, stream=2)


def _recordings(
    kind: Kind, plants: int, motion: str, calibrated_on: str, count: int, stream: int
) -> list[Recording]:
    chosen = units(kind, plants)
    names = [*MOTIONS, *UNINFORMATIVE]
    result = []
    for i in range(count):
        unit = chosen[i % len(chosen)]
        seed = _seed(stream, unit, names.index(motion), i)
        rng = np.random.default_rng([*seed, 1])
        faults = tuple(moderate_faults(rng).tolist())
        result.append(Recording(unit, seed, motion, faults, load(rng), calibrated_on))
    return result


def _seed(stream: int, unit: Unit, *more: int) -> tuple[int, ...]:
    return (_ROOT, stream, 0 if unit.kind == "own" else 1, unit.number, *more)
