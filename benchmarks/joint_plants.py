"""Joints of other makes for joints.py: their physics, their controllers, and their recorded logs.

A joint has two masses, the motor and the load, with a gear of finite stiffness between them. All
figures are in units of the output: rad, N.m and kg.m2, or m, N and kg. A unit of a joint is drawn
by its seed. Its healthy records are from a few days, its tests from a month later on.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp, pi, sin
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple
from zlib import crc32

import numpy as np
import pandas as pd
import yaml
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from ema_core._jit import kernel

Vector = NDArray[np.float64]
Motion = Literal["place", "trapezoid", "cycle", "sweep", "teleoperation", "gait"]

STEP_S: Final = 1e-4
"""Step of the simulation [s]."""
CONTROL_STEPS: Final = 10
CONTROL_S: Final = STEP_S * CONTROL_STEPS
"""Period of the controllers [s]."""
DAY_S: Final = 86_400.0
START_S: Final = 1_772_521_200.0
"""First healthy record: 3 March 2026, 07:00 UTC [s]."""
FIRST_TEST_DAY: Final = 35

_SPREAD_OF_DAYS: Final = 4.0  # standard deviation of the temperature between days [K]
_DAMPING: Final = 0.08  # of the resonance
_KINDS: Final = ("position", "pd", "velocity", "torque")
_REST_S: Final = 0.4
_ROOT: Final = 47_100


@dataclass(frozen=True)
class Joint:
    """A type of joint in units of its output (SI), with its controller, motion and log."""

    control: Literal["position", "pd", "velocity", "torque"]
    motion: Motion
    reach: float
    """Largest distance of the motion from its centre."""
    speed: float
    """Largest speed of the motion."""
    rate_hz: int
    motor_inertia: float
    load_inertia: float
    resonance_hz: float
    """Resonance of the two masses on the gear."""
    motor_friction: float
    """Coulomb friction at the motor."""
    load_friction: float = 0.0
    viscous: float = 0.0
    grease: float = 1.0
    """Exponent of the viscous friction: below 1 where grease thins with speed."""
    stribeck: float = 0.0
    """Static over Coulomb friction, less 1."""
    stribeck_speed: float = 0.01
    load_dependence: float = 0.0
    """Friction over transmitted load; above 1 the gear locks itself."""
    asymmetry: float = 0.0
    gravity: float = 0.0
    """Gravity torque at a right angle."""
    constant_load: float = 0.0
    payload: float = 0.0
    """Gravity and load inertia vary by this share between records."""
    play: float = 0.0
    cogging: float = 0.0
    cogging_periods: float = 0.0
    """Periods of the cogging for each rad or m of the output."""
    warming: float = 6.0
    """Rise of the temperature in operation [K]."""
    viscous_per_kelvin: float = -0.03
    dry_per_kelvin: float = 0.001
    dry_of_days: float = 0.015
    """Standard deviation of dry friction between days, at the same temperature [-]."""
    bandwidth: float = 150.0
    """Bandwidth of the speed loop, or of the position loop of a PD controller [rad/s]."""
    feedforward: bool = False
    ratio: float = 1.0
    """Motor speed over output speed of a rotary joint."""
    lead: float = 0.0
    """Travel for one motor turn of a linear joint."""
    torque_constant: float = 0.1
    effort: Literal["A", "mA", "N.m", "N", "%"] = "A"
    rated: float = 10.0
    """Rated current [A]: 100 per cent."""
    sampling: Literal["mean", "instantaneous"] = "mean"
    effort_noise: float = 0.01
    """Standard deviation of the noise of the effort over the Coulomb friction [-]."""
    effort_step: float = 0.0
    """Resolution of the effort, in the unit of the log."""
    position_step: float = 1e-6
    sensor: Literal["motor", "output"] = "motor"
    has_speed: bool = True
    lag: float = 0.0
    """Samples by which the effort is late."""
    seconds: float = 25.0
    is_varied: bool = False
    """Amplitude and speed of tests are 0.7 to 1.3 times those of the healthy records."""

    @property
    def coulomb(self) -> float:
        """Coulomb friction at motor and load."""
        return float(self.motor_friction + self.load_friction)

    @property
    def has_command(self) -> bool:
        """Whether the log has a position command."""
        return self.control in ("position", "pd")

    @property
    def ampere(self) -> float:
        """Effort at the output for 1 A."""
        return self.torque_constant * (2.0 * pi / self.lead if self.lead else self.ratio)

    @property
    def logged(self) -> float:
        """Effort in the unit of the log for a unit of effort at the output."""
        per_ampere = {"A": 1.0, "mA": 1e3, "%": 100.0 / self.rated}
        return per_ampere[self.effort] / self.ampere if self.effort in per_ampere else 1.0


_TABLE: Final = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))

DEVELOPMENT: Final = {name: Joint(**values) for name, values in _TABLE["development"].items()}
"""Joints for development."""
HELD_OUT: Final = {name: Joint(**values) for name, values in _TABLE["held_out"].items()}
"""Joints for one run at the end: nothing is tuned on them."""
JOINTS: Final = {**DEVELOPMENT, **HELD_OUT}

FRICTION: Final = {f"friction {factor:g}": factor for factor in (1.15, 1.3, 1.6, 2.0)}


@dataclass(frozen=True)
class Case:
    """Faults of a record: factors of the healthy values, and a load over the Coulomb friction."""

    friction: float = 1.0
    viscous: float = 1.0
    torque: float = 1.0
    play: float = 1.0
    load: float = 0.0


HEALTHY: Final = Case()


def cases(joint: Joint, healthy: int) -> dict[str, Case]:
    """Return the cases of a joint by name, with a number of healthy ones."""
    cases = {name: Case(friction=factor) for name, factor in FRICTION.items()}
    cases |= {"viscous": Case(viscous=2.0), "torque": Case(torque=0.9), "load": Case(load=0.5)}
    if joint.play:
        cases["play"] = Case(play=4.0)
    return cases | {f"healthy {i}": HEALTHY for i in range(healthy)}


class Plant(NamedTuple):
    """Constants of the simulation, in units of the output."""

    motor_inertia: float
    load_inertia: float
    stiffness: float
    damping: float
    play: float
    motor_friction: float
    load_friction: float
    viscous: float
    grease: float
    scale_speed: float  # where the exponent of the grease changes nothing
    stribeck: float
    stribeck_speed: float
    load_dependence: float
    asymmetry: float
    gravity: float
    load: float
    cogging: float
    cogging_periods: float
    torque: float  # effort over the effort that the drive assumes


class Controller(NamedTuple):
    """Gains of a controller; its kind is the place in ``_KINDS``."""

    kind: int
    position: float
    speed: float
    integral: float
    inertia: float
    gravity: float
    limit: float
    position_step: float
    at_output: float  # 1 where the position loop closes on the output


@kernel()
def simulate(
    reference: Vector, dry: Vector, thick: Vector, plant: Plant, drive: Controller
) -> Vector:
    """Return output and motor position, motor speed and effort, ``(n, 4)``, every ``CONTROL_S``.

    ``reference`` is position, speed and acceleration, ``(n, 3)``; ``dry`` and ``thick`` are the
    factors of dry and viscous friction, ``(n,)``.
    """
    recorded = np.empty((len(reference), 4))
    position = motor = reference[0, 0]
    v_load = v_motor = integral = effort = 0.0
    h, half = STEP_S, 0.5 * plant.play
    for k in range(len(reference)):
        wanted, v_wanted, a_wanted = reference[k]
        seen = position if drive.at_output > 0.0 else motor
        if drive.position_step > 0.0:
            seen = drive.position_step * np.round(seen / drive.position_step)
        if drive.kind == 1:
            effort = drive.position * (wanted - seen) + drive.speed * (v_wanted - v_motor)
            effort += drive.inertia * a_wanted
        elif drive.kind == 3:
            a = drive.position * (wanted - seen) + drive.speed * (v_wanted - v_motor)
            effort = drive.inertia * (a_wanted + a) + drive.gravity * sin(seen)
        else:
            error = v_wanted + drive.position * (wanted - seen) - v_motor
            bound = 0.6 * drive.limit
            integral = min(max(integral + drive.integral * CONTROL_S * error, -bound), bound)
            effort = drive.speed * error + integral + drive.inertia * a_wanted
        effort = min(max(effort, -drive.limit), drive.limit)
        for _ in range(CONTROL_STEPS):
            twist = motor - position
            gap = min(max(twist, -half), half)
            transmitted = 0.0
            if twist != gap or half == 0.0:
                transmitted = plant.stiffness * (twist - gap) + plant.damping * (v_motor - v_load)
            drop = 1.0
            if plant.stribeck > 0.0:
                drop += plant.stribeck * exp(-((v_motor / plant.stribeck_speed) ** 2))
            push = plant.torque * effort - transmitted
            push += plant.cogging * sin(2.0 * pi * plant.cogging_periods * motor)
            thickness = plant.viscous * thick[k]
            if plant.grease != 1.0:
                thickness *= (abs(v_motor) / plant.scale_speed + 1e-3) ** (plant.grease - 1.0)
            push -= thickness * v_motor
            rub = plant.motor_friction * drop + plant.load_dependence * abs(transmitted)
            free = v_motor + h * push / plant.motor_inertia
            rub *= dry[k] * (1.0 + np.sign(free) * plant.asymmetry)
            lost = h * rub / plant.motor_inertia
            v_motor = np.sign(free) * max(abs(free) - lost, 0.0)
            pull = transmitted - plant.gravity * sin(position) - plant.load
            free = v_load + h * pull / plant.load_inertia
            lost = h * dry[k] * plant.load_friction * drop / plant.load_inertia
            v_load = np.sign(free) * max(abs(free) - lost, 0.0)
            motor += h * v_motor
            position += h * v_load
        recorded[k] = position, motor, v_motor, effort
    return recorded


def _moves(joint: Joint, n: int, size: float, pace: float, seed: tuple[int, ...]) -> Vector:
    """Return point-to-point moves with rests; of a work cycle the points are those of the joint."""
    rng, same = np.random.default_rng(seed), np.random.default_rng(seed[0])
    ramp = 0.25
    parts, at, samples = [np.zeros(round(_REST_S / CONTROL_S))], 0.0, 0
    # A cycle begins anywhere, and repeats its six moves.
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
    """Return position, speed and acceleration of a motion, ``(n, 3)``, every ``CONTROL_S``.

    ``size`` and ``pace`` scale amplitude and speed. The first number of the seed stands for the
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
    """A record: its columns, and its true dry friction over nominal, apart from load and speed."""

    columns: pd.DataFrame
    dry: float


@dataclass(frozen=True)
class Unit:
    """A unit of a joint, by number; days and records are drawn by it."""

    name: str
    seed: int = 0
    joint: Joint = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint", JOINTS[self.name])

    def _seed(self, *numbers: int) -> tuple[int, ...]:
        return (_ROOT + crc32(self.name.encode()) % 10_000, self.seed, *numbers)

    def climate(self, day: int) -> tuple[float, float]:
        """Return temperature above nominal [K] and factor of dry friction of a day."""
        rng = np.random.default_rng(self._seed(2, day))
        return rng.normal(0.0, _SPREAD_OF_DAYS), 1.0 + rng.normal(0.0, self.joint.dry_of_days)

    def record(self, day: int, number: int, case: Case = HEALTHY) -> Record:
        """Return a record of a day; its number determines motion, payload and noise."""
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
        recorded = simulate(reference, dry, thick, plant, controller_of(joint))
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
        """Return the mapping file of the log."""
        joint, length = self.joint, "m" if self.joint.lead else "rad"
        kinds: dict[str, dict[str, Any]] = {
            "A": {"unit": "A", "kind": "equivalent"},
            "mA": {"unit": "mA", "kind": "equivalent"},
            "%": {"unit": "A", "kind": "equivalent", "scale": joint.rated / 100.0},
            "N.m": {"unit": "N.m", "kind": "joint_torque"},
            # The user shaft of a linear joint is its screw.
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
        """Return the description of the unit, as its owner knows it."""
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
        """Write a record to a folder: CSV up to 100 Hz, else Parquet."""
        if self.joint.rate_hz <= 100:
            record.columns.to_csv(path := folder / f"{name}.csv", index=False)
        else:
            record.columns.to_parquet(path := folder / f"{name}.parquet", index=False)
        return path


def healthy_days(records: int, days: int) -> list[tuple[int, int]]:
    """Return day and number of each healthy record; the days are one or two days apart."""
    return [(3 * (i % days) // 2, i // days) for i in range(records)]


def write_truth(folder: Path, truth: Mapping[str, Mapping[str, Any]]) -> None:
    """Write what is true of each record of a folder to truth.json."""
    (folder / "truth.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")


def plant_of(joint: Joint, case: Case = HEALTHY, payload: float = 1.0) -> Plant:
    """Return the plant of a joint; ``payload`` scales gravity and the inertia of the load."""
    reduced = joint.motor_inertia * joint.load_inertia / (joint.motor_inertia + joint.load_inertia)
    omega = 2.0 * pi * joint.resonance_hz
    load = payload * joint.constant_load + case.load * joint.coulomb
    return Plant(
        motor_inertia=float(joint.motor_inertia),
        load_inertia=payload * joint.load_inertia,
        stiffness=reduced * omega**2,
        damping=2.0 * _DAMPING * reduced * omega,
        play=float(joint.play * case.play),
        motor_friction=float(joint.motor_friction),
        load_friction=float(joint.load_friction),
        viscous=joint.viscous * case.viscous,
        grease=float(joint.grease),
        scale_speed=0.5 * joint.speed,
        stribeck=float(joint.stribeck),
        stribeck_speed=joint.stribeck_speed,
        load_dependence=float(joint.load_dependence),
        asymmetry=joint.asymmetry,
        gravity=payload * joint.gravity,
        load=load,
        cogging=float(joint.cogging),
        cogging_periods=float(joint.cogging_periods),
        torque=case.torque,
    )


def controller_of(joint: Joint) -> Controller:
    """Return the controller of a joint, which is designed for its nominal figures."""
    inertia, omega = float(joint.motor_inertia + joint.load_inertia), float(joint.bandwidth)
    largest = joint.coulomb + joint.gravity + joint.constant_load + joint.viscous * joint.speed
    drive = Controller(
        kind=_KINDS.index(joint.control),
        position=omega / 5.0,
        speed=inertia * omega,
        integral=inertia * omega**2 / 8.0,
        inertia=inertia if joint.feedforward else 0.0,
        gravity=0.0,
        limit=4.0 * (largest * (1.0 + joint.load_dependence) + inertia * joint.speed * 10.0),
        position_step=0.0,
        at_output=float(joint.sensor == "output"),
    )
    match joint.control:
        case "pd":  # on the encoder of the log, the others on a fine one
            gains = {"position": inertia * omega**2, "speed": 1.4 * inertia * omega}
            return drive._replace(**gains, position_step=float(joint.position_step))
        case "torque":
            gains = {"position": omega**2, "speed": 2.0 * omega}
            return drive._replace(**gains, inertia=inertia, gravity=float(joint.gravity))
        case "velocity":  # commanded by a slow position loop
            return drive._replace(position=1.0, inertia=0.0)
        case _:
            return drive


def _quantised(values: Vector, step: float) -> Vector:
    return step * np.round(values / step) if step else values
