# SPDX-License-Identifier: Apache-2.0
"""Joints of other manufacturers for joints.py: physics, controllers and recorded logs.

``ema_sim.robot.joint`` simulates them. A unit of a joint is drawn from its seed. Its healthy
records are from a few days, its tests from a month later on.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple
from zlib import crc32

import numpy as np
import pandas as pd
import yaml
from scipy.signal import butter, sosfiltfilt

from ema_sim.robot.joint import (
    CONTROL_S,
    Plant,
    SimulatedJoint,
    Vector,
    controller_of,
    rest,
    simulate_joint,
)
from ema_sim.robot.joint import plant_of as joint_plant

Motion = Literal["place", "trapezoid", "cycle", "sweep", "teleoperation", "gait"]

DAY_S: Final = 86_400.0
START_S: Final = 1_772_521_200.0
"""First healthy record: 3 March 2026, 07:00 UTC [s]."""
FIRST_TEST_DAY: Final = 35

_SPREAD_OF_DAYS: Final = 4.0  # standard deviation of the temperature between days [K]
_REST_S: Final = 0.4
_ROOT: Final = 47_100


@dataclass(frozen=True, kw_only=True)
class Joint(SimulatedJoint):
    """A type of joint with its motion and its log.

    Lengths are in rad for a rotary joint and in m for a linear joint.
    """

    motion: Motion
    reach: float
    """Largest distance of the motion from its centre."""
    rate_hz: int
    payload: float = 0.0
    """Relative variation of gravity and load inertia between records [-]."""
    ratio: float = 1.0
    """Motor speed over output speed of a rotary joint [-]."""
    lead: float = 0.0
    """Travel per motor turn of a linear joint [m]; 0 for a rotary joint."""
    torque_constant: float = 0.1
    effort: Literal["A", "mA", "N.m", "N", "%"] = "A"
    rated: float = 10.0
    """Rated current [A]: 100 % of the logged effort."""
    sampling: Literal["mean", "instantaneous"] = "mean"
    effort_step: float = 0.0
    """Resolution of the effort, in the unit of the log."""
    has_speed: bool = True
    lag: float = 0.0
    """Delay of the effort, in samples of the log."""
    seconds: float = 25.0
    is_varied: bool = False
    """Amplitude and speed of tests are 0.7 to 1.3 times the values of the healthy records."""

    @property
    def has_command(self) -> bool:
        """True if the log has a position command."""
        return self.control in ("position", "pd")

    @property
    def ampere(self) -> float:
        """Effort at the output per ampere [N.m/A; N/A for a linear joint]."""
        return self.torque_constant * (2.0 * pi / self.lead if self.lead else self.ratio)

    @property
    def logged(self) -> float:
        """Logged effort, in the unit of the log, per unit of effort at the output."""
        per_ampere = {"A": 1.0, "mA": 1e3, "%": 100.0 / self.rated}
        return per_ampere[self.effort] / self.ampere if self.effort in per_ampere else 1.0


_TABLE: Final = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))

DEVELOPMENT: Final = {name: Joint(**values) for name, values in _TABLE["development"].items()}
"""Joints for development."""
HELD_OUT: Final = {name: Joint(**values) for name, values in _TABLE["held_out"].items()}
"""Joints for a single run at the end; the monitor is not tuned on them."""
JOINTS: Final = {**DEVELOPMENT, **HELD_OUT}

FRICTION: Final = {f"friction {factor:g}": factor for factor in (1.15, 1.3, 1.6, 2.0)}


@dataclass(frozen=True)
class Case:
    """Faults of a record: factors on the healthy values [-].

    ``load`` is an additional load, in multiples of Coulomb friction.
    """

    friction: float = 1.0
    viscous: float = 1.0
    torque: float = 1.0
    play: float = 1.0
    load: float = 0.0


HEALTHY: Final = Case()


def cases(joint: Joint, healthy: int) -> dict[str, Case]:
    """Return the cases of a joint by name, with ``healthy`` healthy cases."""
    cases = {name: Case(friction=factor) for name, factor in FRICTION.items()}
    cases |= {"viscous": Case(viscous=2.0), "torque": Case(torque=0.9), "load": Case(load=0.5)}
    if joint.play:
        cases["play"] = Case(play=4.0)
    return cases | {f"healthy {i}": HEALTHY for i in range(healthy)}


def _moves(joint: Joint, n: int, size: float, pace: float, seed: tuple[int, ...]) -> Vector:
    """Return the positions of point-to-point moves with rests, ``(n,)``.

    The points of a work cycle depend on the joint only, the points of other motions on the seed.
    """
    rng, same = np.random.default_rng(seed), np.random.default_rng(seed[0])
    ramp = 0.25
    parts, at, samples = [np.zeros(round(_REST_S / CONTROL_S))], 0.0, 0
    # A work cycle begins at any of its six moves, and repeats them.
    points = list(zip(same.uniform(-1.0, 1.0, 6), same.uniform(0.5, 1.0, 6), strict=True))
    number = int(rng.integers(6))
    while samples < n:
        to, share = points[number % 6]
        if joint.motion != "cycle":
            to, share = float(rng.uniform(-1.0, 1.0)), float(rng.uniform(0.4, 1.0))
        rest = rng.uniform(0.15, 0.5) if joint.motion != "cycle" else rng.normal(0.3, 0.01)
        distance, fastest = size * joint.reach * to - at, pace * joint.speed * share
        is_trapezoid = joint.motion != "place"
        peak = 1.0 / (1.0 - ramp) if is_trapezoid else 1.875
        steps = round((peak * abs(distance) / fastest + 0.25) / CONTROL_S)
        s = np.linspace(0.0, 1.0, steps)
        if is_trapezoid:
            s = np.cumsum(np.clip(np.minimum(s, 1.0 - s) / ramp, 0.0, 1.0))
            s /= s[-1]
        else:
            s = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        parts += [at + distance * s, np.full(round(abs(rest) / CONTROL_S), at + distance)]
        samples += len(parts[-1]) + len(parts[-2])
        at, number = at + distance, number + 1
    return np.concatenate(parts)[:n]


def reference_of(joint: Joint, size: float, pace: float, seed: tuple[int, ...]) -> Vector:
    """Return position, speed and acceleration of a motion at steps of ``CONTROL_S``, ``(n, 3)``.

    ``size`` and ``pace`` scale amplitude and speed. The first number of the seed identifies the
    joint.
    """
    length, rng = round(joint.seconds / CONTROL_S), np.random.default_rng(seed)
    n = length + round(1.0 / CONTROL_S)  # the filters below disturb the end
    t = CONTROL_S * np.arange(n)
    reach, speed = size * joint.reach, pace * joint.speed
    start = np.clip((t - _REST_S) / 1.5, 0.0, 1.0)
    fade = start * start * (3.0 - 2.0 * start)
    match joint.motion:
        case "sweep":
            low, high = speed / reach / 12.0, speed / reach * 0.8
            part = (t / 10.0 + rng.random()) % 2.0
            omega = low * (high / low) ** np.where(part < 1.0, part, 2.0 - part)
            phase = rng.uniform(0.0, 2.0 * pi) + np.cumsum(omega) * CONTROL_S
            q = fade * reach * np.sin(phase) * np.minimum(1.0, 1.5 * speed / reach / omega / 2.0)
        case "teleoperation":
            band = butter(3, 0.2 * speed / reach, fs=1.0 / CONTROL_S, output="sos")
            noise = sosfiltfilt(band, rng.standard_normal(n + 4000))[2000 : n + 2000]
            q = fade * np.tanh(noise / noise.std()) * reach
        case "gait":
            sway = sosfiltfilt(
                butter(2, 0.3, fs=1.0 / CONTROL_S, output="sos"), rng.standard_normal(n)
            )
            omega = speed / reach / 1.5 * (1.0 + 0.1 * sway / sway.std())
            phase = rng.uniform(0.0, 2.0 * pi) + np.cumsum(omega) * CONTROL_S
            q = fade * reach * (np.sin(phase) + 0.25 * np.sin(2.0 * phase + 1.0))
        case _:
            q = _moves(joint, n, size, pace, seed)
    smooth = butter(2, 12.0 if joint.motion != "gait" else 25.0, fs=1.0 / CONTROL_S, output="sos")
    q = np.asarray(sosfiltfilt(smooth, q))
    v = np.gradient(q, CONTROL_S)
    return np.column_stack([q, v, np.gradient(v, CONTROL_S)])[:length]


class Record(NamedTuple):
    """Columns of a record, and its true dry friction over nominal, at nominal load and speed."""

    columns: pd.DataFrame
    dry: float


@dataclass(frozen=True)
class Unit:
    """A unit of a joint; name and seed determine its days and records."""

    name: str
    seed: int = 0
    joint: Joint = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint", JOINTS[self.name])

    def _seed(self, *numbers: int) -> tuple[int, ...]:
        return (_ROOT + crc32(self.name.encode()) % 10_000, self.seed, *numbers)

    def climate(self, day: int) -> tuple[float, float]:
        """Return the temperature above nominal [K] and the factor on dry friction [-] of a day."""
        rng = np.random.default_rng(self._seed(2, day))
        return rng.normal(0.0, _SPREAD_OF_DAYS), 1.0 + rng.normal(0.0, self.joint.dry_of_days)

    def record(self, day: int, number: int, case: Case = HEALTHY) -> Record:
        """Return a record; day and number determine its motion, payload and noise."""
        joint, rng = self.joint, np.random.default_rng(self._seed(1, day, number))
        ambient, dry_of_day = self.climate(day)
        is_test = day >= FIRST_TEST_DAY
        size, pace = rng.uniform(0.7, 1.3, 2) if is_test and joint.is_varied else (1.0, 1.0)
        reference = reference_of(joint, size, pace, self._seed(3, day, number))
        t = CONTROL_S * np.arange(len(reference))
        warmth = 1.0 - rng.uniform(0.2, 1.0) * np.exp(-t / 400.0)
        kelvin = ambient + joint.warming * warmth
        thick = np.exp(joint.viscous_per_kelvin * kelvin)
        dry = case.friction * dry_of_day * (1.0 + joint.dry_per_kelvin * kelvin)
        payload = 1.0 + joint.payload * rng.uniform(-1.0, 1.0)
        plant = plant_of(joint, case, payload)
        conditions = np.column_stack([dry, thick, np.zeros((len(t), 2))])
        state = rest(float(reference[0, 0]))
        recorded = simulate_joint(reference, conditions, plant, controller_of(joint), state)
        return Record(self._log(reference, recorded, day, number, rng), float(dry.mean()))

    def _log(
        self, reference: Vector, recorded: Vector, day: int, number: int, rng: np.random.Generator
    ) -> pd.DataFrame:
        """Return the columns that the drive logs."""
        joint = self.joint
        each = round(1.0 / (joint.rate_hz * CONTROL_S))
        n = len(reference) // each
        last = slice(each - 1, n * each, each)
        output, motor, speed, effort = recorded.T
        t = CONTROL_S * np.arange(1, len(effort) + 1)
        late = np.interp(t - joint.lag / joint.rate_hz, t, effort)
        is_mean = joint.sampling == "mean"
        effort = late[: n * each].reshape(n, each).mean(axis=1) if is_mean else late[last]
        effort = effort + joint.effort_noise * joint.coulomb * rng.standard_normal(n)
        position = (motor if joint.sensor == "motor" else output)[last]
        start = START_S + DAY_S * day + 900.0 * number + rng.uniform(0.0, 60.0)
        columns = {
            "time_s": np.round(start + t[last], 6),
            "position": _quantised(position, joint.position_step),
        }
        if joint.has_command:
            columns["command"] = reference[last, 0]
        if joint.has_speed:
            noise = 1e-3 * joint.speed * rng.standard_normal(n)
            columns["speed"] = speed[last] + noise
        columns["effort"] = _quantised(joint.logged * effort, joint.effort_step)
        return pd.DataFrame(columns).round(9)

    def mapping(self) -> dict[str, Any]:
        """Return the content of the mapping file for the log."""
        joint, length = self.joint, "m" if self.joint.lead else "rad"
        kinds: dict[str, dict[str, Any]] = {
            "A": {"unit": "A", "kind": "equivalent"},
            "mA": {"unit": "mA", "kind": "equivalent"},
            "%": {"unit": "A", "kind": "equivalent", "scale": joint.rated / 100.0},
            "N.m": {"unit": "N.m", "kind": "joint_torque"},
            # The user shaft of a linear joint is the screw.
            "N": {"unit": "N.m", "kind": "joint_torque", "scale": joint.lead / (2.0 * pi)},
        }
        sections: dict[str, Any] = {"position": {"source": "position", "unit": length}}
        if joint.has_command:
            sections["command"] = {"source": "command", "unit": length}
        if joint.has_speed:
            sections["speed"] = {"source": "speed", "unit": f"{length}/s", "shaft": "user"}
        sections["current"] = {
            "source": "effort",
            **kinds[joint.effort],
            "sampling": joint.sampling,
        }
        return sections | {"clock": {"source": "time_s"}}

    def description(self) -> dict[str, Any]:
        """Return the content of the unit's description file: only values that an owner knows."""
        joint = self.joint
        parameters = {"tau": 1.0 / joint.ratio, "k_t": joint.torque_constant}
        if joint.lead:
            parameters["lead"] = joint.lead
        scale = 2.0 * pi / joint.lead if joint.lead else joint.ratio
        parameters["BLK"] = max(joint.play * scale, 1e-4)
        return {
            "actuator_id": self.name,
            "serial_number": f"{self.name.upper()}-{self.seed}",
            "sample_period": 1.0 / joint.rate_hz,
            "drive": "unknown",
            "acquisition": {"current": joint.sampling},
            "parameters": parameters,
        }

    def write_description(self, folder: Path) -> None:
        """Write mapping.yaml and actuator.yaml to a folder."""
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in (("mapping", self.mapping()), ("actuator", self.description())):
            (folder / f"{name}.yaml").write_text(
                yaml.safe_dump(content, sort_keys=False), encoding="utf-8"
            )

    def write(self, record: Record, folder: Path, name: str) -> Path:
        """Write a record to a folder, as CSV up to 100 Hz, else as Parquet. Return its path."""
        if self.joint.rate_hz <= 100:
            record.columns.to_csv(path := folder / f"{name}.csv", index=False)
        else:
            record.columns.to_parquet(path := folder / f"{name}.parquet", index=False)
        return path


def healthy_days(records: int, days: int) -> list[tuple[int, int]]:
    """Return day and number of each healthy record; the days are one or two days apart."""
    return [(3 * (i % days) // 2, i // days) for i in range(records)]


def write_truth(folder: Path, truth: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the true values of each record of a folder to truth.json."""
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")


def plant_of(joint: Joint, case: Case = HEALTHY, payload: float = 1.0) -> Plant:
    """Return the plant of a joint; ``payload`` scales gravity and the inertia of the load."""
    plant = joint_plant(joint, payload)
    return plant._replace(
        play=plant.play * case.play,
        viscous=plant.viscous * case.viscous,
        load=plant.load + case.load * joint.coulomb,
        torque=case.torque,
    )


def _quantised(values: Vector, step: float) -> Vector:
    return step * np.round(values / step) if step else values
