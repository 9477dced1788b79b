# SPDX-License-Identifier: Apache-2.0
"""Synthetic messages of a monitor and its actuators, for tests of the page.

The values are plausible and consistent with each other, but not computed by a model.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from ema_core.faults import FAULT_NAMES, FAULTS
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_interfaces.msg import (
    ActuatorDescription,
    Advice,
    Confusion,
    FaultEstimate,
    FaultForecast,
    FaultHealth,
    FaultVector,
    Health,
    HealthForecast,
    HiddenCause,
    RemainingUsefulLife,
    TelemetryBlock,
    UnitEvent,
    UnitHistory,
    UnitTest,
    WindowFit,
)
from ema_ros.stamps import stamp_to_message
from ema_ros.status import hardware_name

NAMESPACE = "/ema"
HOURS_PER_TEST = 10.0
SIGMA = 0.004
SAMPLE_PERIOD_S = 1e-4
BLOCK = 100
NS = 1_000_000_000

_LIMITED = [fault for fault in FAULTS if fault.limit is not None]
_REQUIREMENTS = (
    ("tracking_error", 0.0021, 0.004, False, "rad"),
    ("bandwidth", 16.4, 12.0, True, "Hz"),
    ("torque_margin", 0.62, 0.3, True, "N.m"),
    ("free_play", 0.0008, 0.002, False, "rad"),
)


@dataclass
class Unit:
    """An actuator whose faults grow from test to test."""

    actuator_id: str
    worst: int
    """Index of the fault that grows fastest, among the faults with a limit."""
    share: float
    """Distance of this fault from healthy after the latest test, as a share of its limit."""
    tests: int
    """Number of valid tests."""
    rng: np.random.Generator
    level: int | None = None
    """Level after the latest test; None: the level follows from the share."""
    costs: bool = True
    """Whether the monitor knows costs and therefore gives advice."""
    window: int = 0
    """Number of the latest window."""
    events: list[UnitEvent] = field(default_factory=list)

    @property
    def serial_number(self) -> str:
        return f"SN-{abs(hash_of(self.actuator_id)) % 9000 + 1000}"

    def shares(self, test: float) -> np.ndarray:
        """Return the share of the limit that each fault with a limit has reached after a test."""
        shares = np.full(len(_LIMITED), 0.02)
        growth = math.exp(3.0 * (test - self.tests) / max(self.tests, 1))
        shares[self.worst] = self.share * growth
        shares[0] = max(shares[0], 0.1 * test / max(self.tests, 1))
        return shares

    def values(self, test: float) -> np.ndarray:
        values = {f.name: f.healthy for f in FAULTS}
        for fault, share in zip(_LIMITED, self.shares(test), strict=True):
            assert fault.limit is not None
            values[fault.name] = fault.healthy + share * fault.limit
        return np.array([values[name] for name in FAULT_NAMES])

    def life_hours(self, test: float) -> tuple[float, float, float]:
        """Return the 5, 50 and 95 % quantiles of the remaining life [h] after a test."""
        share = float(self.shares(test)[self.worst])
        if share >= 1.0:
            return 0.0, 0.0, 0.0
        median = -math.log(share) / 3.0 * max(self.tests, 1) * HOURS_PER_TEST
        return 0.62 * median, median, 1.55 * median

    def level_at(self, test: float) -> int:
        if self.level is not None and test == self.tests:
            return self.level
        share = float(self.shares(test)[self.worst])
        return ERROR if share >= 1.0 else WARN if share > 0.25 else OK


def hash_of(text: str) -> int:
    """Return a hash of a text that is the same in all processes."""
    return int.from_bytes(text.encode(), "big") % 1_000_003


def units(count: int, seed: int = 0) -> list[Unit]:
    """Return ``count`` units; the wear of the first nine is fixed, of the others random."""
    rng = np.random.default_rng(seed)
    names = ["left_outboard_flap", "left_inboard_flap", "right_inboard_flap", "right_outboard_flap"]
    names += ["left_aileron", "right_aileron", "elevator", "rudder", "stabilizer_trim"]
    names += [f"actuator_{i:03d}" for i in range(len(names), count)]
    shares = [0.86, 0.12, 0.41, 1.12, 0.05, 0.33, 0.08, 0.18, 0.62]
    shares += list(rng.uniform(0.02, 0.35, max(count - len(shares), 0)))
    return [
        Unit(names[i], int(rng.integers(len(_LIMITED))), shares[i], 40 + i % 30, rng)
        for i in range(count)
    ]


def message_of(unit: Unit, kind: Any, stamp_ns: int, /, **fields: Any) -> Any:
    """Return a message of type ``kind`` with the name, serial number and stamp of a unit."""
    message = kind(actuator_id=unit.actuator_id, **fields)
    message.header.stamp = stamp_to_message(stamp_ns)
    if hasattr(message, "serial_number"):
        message.serial_number = unit.serial_number
    return message


def description(unit: Unit, now_ns: int) -> ActuatorDescription:
    fields = {"model": "BLDC flap actuator", "sample_period": SAMPLE_PERIOD_S}
    return message_of(unit, ActuatorDescription, now_ns, **fields)


def _life(quantiles: Sequence[float], criterion: str) -> RemainingUsefulLife:
    low, middle, high = quantiles
    return RemainingUsefulLife(
        known=True,
        hours_05=low,
        hours_50=middle,
        hours_95=high,
        cycles_05=low / HOURS_PER_TEST,
        cycles_50=middle / HOURS_PER_TEST,
        cycles_95=high / HOURS_PER_TEST,
        criterion=criterion,
    )


def unknown_life(reason: str) -> RemainingUsefulLife:
    nan = math.nan
    return RemainingUsefulLife(
        known=False, hours_05=nan, hours_50=nan, hours_95=nan,
        cycles_05=nan, cycles_50=nan, cycles_95=nan, reason=reason,
    )  # fmt: skip


def health(unit: Unit, stamp_ns: int) -> Health:
    """Return the health after the latest test of a unit."""
    level = unit.level_at(unit.tests)
    shares, values = unit.shares(unit.tests), unit.values(unit.tests)
    worst = _LIMITED[unit.worst]
    hours = unit.tests * HOURS_PER_TEST
    quantiles = unit.life_hours(unit.tests)
    assert worst.limit is not None
    limit = worst.healthy + worst.limit
    life = _life(quantiles, f"{worst.label} exceeds {limit:g}")
    unlimited = unknown_life("it does not grow")
    faults = []
    for number, fault in enumerate(_LIMITED):
        assert fault.limit is not None
        grows = number == unit.worst
        faults.append(
            FaultHealth(
                name=fault.name,
                level=level if grows else OK,
                value=float(values[FAULT_NAMES.index(fault.name)]),
                sigma=SIGMA,
                limit=fault.healthy + fault.limit,
                limit_is_lower=False,
                trend=float(3.0 * shares[number] * fault.limit / hours) if grows else 2e-6,
                unit="1",
                rul=life if grows else unlimited,
            )
        )
    requirements = [
        FaultHealth(
            name=name, level=OK, value=value, sigma=0.02 * value, limit=requirement,
            limit_is_lower=is_lower, trend=0.01 * value / 100.0, unit=symbol,
            rul=_life([3.0 * q for q in quantiles], f"{name} reaches {requirement:g} {symbol}"),
        )
        for name, value, requirement, is_lower, symbol in _REQUIREMENTS
    ]  # fmt: skip
    worst_value = f"{worst.label} {values[FAULT_NAMES.index(worst.name)]:.3g}"
    causes = {
        OK: "",
        WARN: f"{worst_value} (warns above {0.2 * limit:.3g}, fails above {limit:.3g})",
        ERROR: f"{worst_value} (failed: above {limit:.3g})",
        STALE: "",
    }
    low, middle, _ = quantiles
    removal = {
        ERROR: f"Remove now: failed since {hours - 20:,.0f} h (now {hours:,.0f} h): "
        f"{worst.label} exceeds {limit:g}"
    }.get(
        level,
        f"Remove before {hours + low:,.0f} service hours (in {low:,.0f} h; 5 % risk of failure "
        f"until then); median end of life {hours + middle:,.0f} h: {worst.label} exceeds {limit:g}",
    )
    return message_of(
        unit,
        Health,
        stamp_ns,
        level=level,
        last_level=unit.level_at(unit.tests - 1e-9) if level == STALE else level,
        health_index=float(np.clip(1.0 - shares.max(), 0.0, 1.0)),
        severity=int(np.searchsorted([0.25, 0.5, 0.8, 1.0], shares.max(), side="right")),
        confidence=0.0 if level == STALE else 0.97,
        dominant_fault=worst.name if level != OK else "",
        faults=faults,
        requirements=requirements,
        rul_faults=life,
        rul_requirements=requirements[0].rul,
        rul=life,
        flight_hours=hours,
        cycles=unit.tests,
        removal_risk=0.05,
        removal_hours=low,
        removal_cycles=low / HOURS_PER_TEST,
        removal_days=math.nan,
        growth_factor=1.0,
        assumption="future use as in the past",
        cause=causes[level],
        removal=removal,
        reason="no valid estimate for three expected periods" if level == STALE else "",
    )


def _covariance(rng: np.random.Generator) -> np.ndarray:
    mixing = rng.normal(size=(8, 8)) * 0.35 + np.eye(8)
    covariance = mixing @ mixing.T
    scale = SIGMA / np.sqrt(np.diag(covariance))
    return covariance * np.outer(scale, scale)


def estimate(
    unit: Unit, stamp_ns: int, refused: str = "", verdict: int = FaultEstimate.REFUSED
) -> FaultEstimate:
    """Return the estimate of a unit's latest window.

    If ``refused`` is not empty, the estimate is invalid for this reason, with the given verdict.
    """
    values = np.clip(unit.values(unit.tests) + SIGMA * unit.rng.normal(size=8), 0.0, 1.0)
    insignificant = sum(1 << k for k, f in enumerate(FAULTS) if abs(values[k] - f.healthy) < 0.02)
    causes = []
    if unit.worst % 2 == 0 or unit.share > 0.8:
        causes = [HiddenCause(name="winding_temperature", value=41.3, sigma=2.6, unit="K")]
    return message_of(
        unit,
        FaultEstimate,
        stamp_ns,
        window=unit.window,
        window_start=stamp_to_message(stamp_ns - NS // 2),
        window_end=stamp_to_message(stamp_ns),
        faults=FaultVector(**dict(zip(FAULT_NAMES, values.tolist(), strict=True))),
        covariance=_covariance(unit.rng).ravel(),
        insignificant=insignificant,
        fitness=1.3e-4,
        goodness_of_fit=1.24,
        goodness_limit=3.5,
        unexplained_share=0.031,
        causes=causes,
        alternatives=[Confusion(part=["winding_temperature"], stand_in=["torque_constant"])]
        if causes
        else [],
        verdict=verdict if refused else FaultEstimate.VALID,
        excitation=0.12,
        excitation_limit=0.02,
        algorithm="levenberg_marquardt",
        seed=1,
        evaluations=1260,
        warm_start=True,
        computing_time=0.061,
        calibration_id="flap-2031",
        calibration_windows=20,
        valid=not refused,
        reason=refused,
    )


def forecast(unit: Unit, stamp_ns: int) -> HealthForecast:
    """Return quantiles of all faults with a limit at 30 times until the end of life."""
    low, middle, high = unit.life_hours(unit.tests)
    end = max(1.1 * middle, 10.0)
    hours = np.linspace(0.0, end, 30)
    faults = []
    for number, fault in enumerate(_LIMITED):
        assert fault.limit is not None
        now = float(unit.shares(unit.tests)[number]) * fault.limit
        rate = -math.log(min(max(now / fault.limit, 1e-3), 1.0))
        grows = number == unit.worst and middle > 0.0
        rows = [
            fault.healthy + now * np.exp(rate * hours / until if grows else 0.0 * hours)
            for until in (high, middle, low)
        ]
        values = np.array(rows)
        values[0] -= SIGMA
        values[2] += SIGMA
        faults.append(
            FaultForecast(
                name=fault.name, limit=fault.limit, values=np.clip(values, 0.0, 1.0).ravel()
            )
        )
    return message_of(
        unit,
        HealthForecast,
        stamp_ns,
        flight_hours=unit.tests * HOURS_PER_TEST,
        growth_factor=1.0,
        hours=hours,
        probabilities=[0.05, 0.5, 0.95],
        faults=faults,
    )


def advice(unit: Unit, stamp_ns: int) -> Advice:
    """Return the advice for a unit, which depends on its remaining life."""
    low, middle, _ = unit.life_hours(unit.tests)
    hours = unit.tests * HOURS_PER_TEST
    action = Advice.REMOVE if low < 60.0 else Advice.INSPECT if low < 200.0 else Advice.CONTINUE
    from_now = min(low, 0.8 * middle) if action != Advice.CONTINUE else HOURS_PER_TEST
    risk = "risk of failure until a removal can follow the next test, in 20 h"
    reasons = {  # as in ema_monitor.prognosis.advice
        Advice.REMOVE: f"the removal must not wait: 41 % {risk}; 21.3 EUR/h if the decision "
        "waits, 11.4 EUR/h if not",
        Advice.INSPECT: "an inspection now, which measures friction, reduces the expected cost "
        "from 12.9 EUR/h to 11.4 EUR/h",
        Advice.CONTINUE: f"the decision can wait for the next test: 0.1 % {risk}; 11.4 EUR/h "
        "if the decision waits, 12.6 EUR/h if not",
    }
    return message_of(
        unit,
        Advice,
        stamp_ns,
        action=action if unit.costs else Advice.UNKNOWN,
        flight_hours=hours + from_now,
        from_now=from_now,
        probability_of_failure=0.012,
        expected_cost=11.4,
        cost_of_immediate_removal=19.7,
        cost_unit="EUR",
        reason=reasons[action] if unit.costs else "no costs are given",
    )


def history(unit: Unit, now_ns: int, period_s: float, first: int = 1) -> UnitHistory:
    """Return the tests of a unit from number ``first`` to the latest, and its events."""
    tests = []
    for number in range(first, unit.tests + 1):
        rng = np.random.default_rng([hash_of(unit.actuator_id), number])
        values = unit.values(number) + SIGMA * rng.normal(size=8)
        low, middle, high = unit.life_hours(number)
        scatter = math.exp(0.06 * rng.normal())
        tests.append(
            UnitTest(
                stamp=stamp_to_message(now_ns - int((unit.tests - number) * period_s * NS)),
                flight_hours=number * HOURS_PER_TEST,
                cycles=number,
                faults=np.clip(values, 0.0, 1.0),
                sigmas=np.full(8, SIGMA),
                insignificant=sum(
                    1 << k for k, f in enumerate(FAULTS) if abs(values[k] - f.healthy) < 0.02
                ),
                level=unit.level_at(number),
                health_index=float(np.clip(1.0 - unit.shares(number).max(), 0.0, 1.0)),
                dominant_fault=_LIMITED[unit.worst].name,
                rul_known=number > 4,
                rul_05=low * scatter,
                rul_50=middle * scatter,
                rul_95=high * scatter,
            )
        )
    label = _LIMITED[unit.worst].label
    texts = (
        (0.05, "history", "the history continues 3 earlier tests"),
        (0.25, "calibration", "the monitor uses calibration flap-2031 with 20 healthy windows"),
        (0.4, "gap", "2 tests missed"),
        (0.55, "outlier", "friction: 0.214 is far from the value that earlier tests predict"),
        (0.7, "restart", "the monitor was restarted"),
        (0.82, "fault", f"{label}: OK → WARN"),
    )
    events = []
    for position, kind, text in texts:
        test = tests[int(position * len(tests))]
        hours = test.flight_hours
        events.append(UnitEvent(stamp=test.stamp, flight_hours=hours, kind=kind, text=text))
    return message_of(unit, UnitHistory, now_ns, tests=tests, events=[*events, *unit.events])


def addition(unit: Unit, now_ns: int, kind: str, text: str) -> UnitHistory:
    """Add an event to a unit; return the message with which the monitor publishes it."""
    event = UnitEvent(stamp=stamp_to_message(now_ns), flight_hours=math.nan, kind=kind, text=text)
    unit.events.append(event)
    message = UnitHistory(actuator_id=unit.actuator_id, serial_number=unit.serial_number)
    message.is_addition, message.events = True, [event]
    return message


def _chirp(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    phase = 2.0 * np.pi * (4.0 * t + 12.0 * t**2)
    command = 0.03 * np.sin(phase) * (1.0 - 0.5 * t)
    speed = np.gradient(command, t) * 400.0
    current = 2.2 * np.tanh(speed / 40.0) + 0.012 * np.gradient(speed, t)
    return command, speed, np.clip(current, -22.0, 22.0)


def window_fit(unit: Unit, stamp_ns: int) -> WindowFit:
    """Return measured and estimated signals of half a second, with 400 samples each."""
    t = np.linspace(0.0, 0.5, 400, endpoint=False)
    command, speed, current = _chirp(t)
    rng = unit.rng
    return message_of(
        unit,
        WindowFit,
        stamp_ns,
        window=unit.window,
        period=float(t[1]),
        start=0.0,
        command=command.astype(np.float32),
        position=np.roll(command, 3).astype(np.float32),
        current=(current + 0.15 * rng.normal(size=400)).astype(np.float32),
        estimated_current=current.astype(np.float32),
        speed=(speed + 0.8 * rng.normal(size=400)).astype(np.float32),
        estimated_speed=(speed * 1.002).astype(np.float32),
    )


_T = np.arange(20_000) * SAMPLE_PERIOD_S
_COMMAND, _SPEED, _CURRENT = _chirp(_T % 0.5)


def block(unit: Unit, number: int, stamp_ns: int) -> TelemetryBlock:
    """Return block ``number`` of the telemetry: 10 ms; its first sample ends at the stamp."""
    start = number * BLOCK % len(_T)
    part = slice(start, start + BLOCK)
    noise = unit.rng.normal(size=BLOCK)
    return message_of(
        unit,
        TelemetryBlock,
        stamp_ns,
        sample_period=SAMPLE_PERIOD_S,
        first_index=number * BLOCK,
        command=_COMMAND[part],
        current=_CURRENT[part] + 0.2 * noise,
        position=np.roll(_COMMAND, 30)[part],
        speed=_SPEED[part],
    )


def diagnostics(units: list[Unit], now_ns: int) -> DiagnosticArray:
    """Return the diagnostic statuses that a monitor publishes every second."""
    statuses = []

    def status(level: int, task: str, text: str, unit: Unit | None = None, **values: str) -> None:
        hardware = hardware_name(NAMESPACE, "monitor")
        if unit is not None:
            hardware = hardware_name(NAMESPACE, unit.actuator_id, unit.serial_number)
        statuses.append(
            DiagnosticStatus(
                level=bytes([level]),
                name=f"{NAMESPACE}/monitor: {task}",
                message=text,
                hardware_id=hardware,
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
        )

    status(OK, "lifecycle", "active")
    status(OK, "peers", "in contact with 2 nodes")
    status(OK, "identification", "waiting for windows")
    for unit in units:
        telemetry = f"{unit.actuator_id} telemetry"
        values = {"windows": str(unit.window), "latency [s]": "0.123456789"}
        status(OK, telemetry, "receiving", unit, **values)
        status(unit.level_at(unit.tests), f"{unit.actuator_id} health", "see health", unit)
    message = DiagnosticArray(status=statuses)
    message.header.stamp = stamp_to_message(now_ns)
    return message
