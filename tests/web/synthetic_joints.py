# SPDX-License-Identifier: Apache-2.0
"""Synthetic messages of a monitor about robot joints, for tests of the page.

The values are plausible and consistent with each other, but not computed by a model.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import synthetic_units as synthetic

from ema_core.faults import FAULT_NAMES, FAULTS
from ema_core.levels import ERROR, OK, STALE, WARN
from ema_interfaces.msg import (
    ActuatorDescription,
    BaselineStatus,
    FaultEstimate,
    FaultHealth,
    FaultVector,
    FrictionCurve,
    Health,
    HiddenCause,
    QuantityChange,
    UnitEvent,
    UnitHistory,
    UnitTest,
)
from ema_interfaces.srv import ChangeBaseline
from ema_ros.stamps import stamp_to_message

UNKNOWN_DRIVE = 2
MIN_RECORDS = 3
SIGMA = 0.02  # standard deviation of the relative change of friction [-]

_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_FRICTION = next(fault for fault in FAULTS if fault.name == "friction")
_FIELDS = FaultVector.get_fields_and_field_types()


@dataclass
class Joint(synthetic.Unit):
    """A joint that learns its baseline, or whose friction grows from record to record."""

    change: float = 0.0
    """Current relative change of friction [-]."""
    changed: tuple[tuple[str, float, str], ...] = ()
    """Other changed quantities: name, change and unit."""
    records: int = 12
    """Number of records of the baseline."""
    needed: int = 0
    """Number of records that the baseline needs; 0: not known."""
    reason: str = ""
    """Why the baseline cannot be accepted; "" if it can."""
    author: str = "Ada Lovelace"
    """Person who accepted the baseline; "" while the joint learns."""
    temperature: float = math.nan
    """Rise of the winding temperature [K]; NaN: not measured."""

    @property
    def is_learning(self) -> bool:
        return not self.author

    def change_at(self, test: int) -> float:
        """Return the relative change of friction in a record, including noise [-]."""
        growth = math.exp(4.0 * (test - self.tests) / max(self.tests, 1))
        noise = np.random.default_rng([synthetic.hash_of(self.actuator_id), test]).normal()
        return self.change * growth + SIGMA * float(noise)

    def level_of(self, test: int) -> int:
        if self.level is not None and test == self.tests:
            return self.level
        change = self.change_at(test)
        return ERROR if change > 0.5 else WARN if change > 0.15 or self.changed else OK


def robots(count: int, seed: int = 0) -> list[Joint]:
    """Return joints in all states; joints after the fourteenth belong to robots of six joints."""
    rng = np.random.default_rng(seed)
    fields: dict[str, dict[str, Any]] = {
        "left/elbow": {"change": 0.96, "temperature": 31.0},
        "left/wrist_2": {"change": 0.34, "changed": (("play", 0.0021, "rad"),)},
        "left/wrist_3": {"author": "", "records": 4, "needed": 10},
        "left/shoulder_lift": {"temperature": 12.4},
        "right/wrist_1": {
            "author": "",
            "records": 2,
            "reason": f"2 usable records: a baseline needs at least {MIN_RECORDS}",
        },
        "right/wrist_3": {"author": "", "records": 12},
        "right/elbow": {"changed": (("torque_per_ampere", -0.12, "-"),)},
        "right/shoulder_pan": {"level": STALE},
        "gripper": {},
    }
    names = [f"{robot}/{joint}" for robot in ("left", "right") for joint in _JOINTS]
    names += ["gripper", "rail"]
    cells = [f"cell_{number // 6 + 1:02d}/{_JOINTS[number % 6]}" for number in range(count)]
    return [
        Joint(name, 0, 0.1, 90 + 7 * number % 40, rng, **fields.get(name, {}))
        for number, name in enumerate([*names, *cells][:count])
    ]


def description(joint: Joint, now_ns: int) -> ActuatorDescription:
    return synthetic.message_of(
        joint, ActuatorDescription, now_ns, drive=UNKNOWN_DRIVE, sample_period=0.002,
        effort_kind=1, torque_constant=1.0, gear_ratio=1.0,
    )  # fmt: skip


def baseline(joint: Joint, now_ns: int) -> BaselineStatus:
    """Return the baseline status of a joint."""
    is_known = joint.records >= MIN_RECORDS
    same_day = 0.3 / math.sqrt(joint.records) if is_known else math.nan
    advice = ["3 more healthy records on 2 more days would lower 22 % to 12 %"] if is_known else []
    return synthetic.message_of(
        joint,
        BaselineStatus,
        now_ns,
        state=BaselineStatus.LEARNING if joint.is_learning else BaselineStatus.ACCEPTED,
        records=joint.records,
        records_needed=joint.needed,
        days=min(joint.records, 2),
        slowest=0.21 if is_known else math.nan,
        fastest=1.34 if is_known else math.nan,
        forward_share=0.52 if is_known else math.nan,
        detectable_same_day=same_day,
        detectable_other_day=2.5 * same_day,
        advice=advice if joint.is_learning else [],
        reason=joint.reason,
        calibration_id="" if joint.is_learning else f"{joint.actuator_id} 2031-03-12",
        author=joint.author,
        accepted=stamp_to_message(0 if joint.is_learning else now_ns - 40 * 86_400 * synthetic.NS),
    )


def _quantities(joint: Joint) -> list[QuantityChange]:
    changes = {"friction": (joint.change_at(joint.tests), "-")}
    changes |= {name: (change, unit) for name, change, unit in joint.changed}
    for name in ("viscous_friction", "torque_per_ampere", "inertia"):
        changes.setdefault(name, (0.01, "-"))
    quantities = []
    for name, (change, unit) in changes.items():
        half_width = SIGMA * 1.645 if unit == "-" else 0.1 * abs(change)
        quantities.append(
            QuantityChange(
                name=name,
                judgement=QuantityChange.CHANGED if abs(change) > 3.0 * half_width
                else QuantityChange.UNCHANGED,
                change=change,
                low=change - half_width,
                high=change + half_width,
                smallest_change=3.0 * half_width,
                unit=unit,
            )
        )  # fmt: skip
    quantities.append(
        QuantityChange(
            name="gravity",
            judgement=QuantityChange.NOT_JUDGED,
            change=math.nan,
            low=math.nan,
            high=math.nan,
            smallest_change=math.nan,
            unit="-",
            reason="the joint turns about a vertical axis",
            reason_codes=["quantity_unjudged"],
        )
    )
    return quantities


def estimate(joint: Joint, now_ns: int) -> FaultEstimate:
    """Return the estimate of the latest record; a refusal while the joint learns."""
    measured = []
    if math.isfinite(joint.temperature):
        measured = [HiddenCause(name="winding_temperature", unit="K", sigma=2.0)]
        measured[0].value = joint.temperature
    common = {
        "window": joint.window,
        "window_start": stamp_to_message(now_ns - 20 * synthetic.NS),
        "window_end": stamp_to_message(now_ns),
        "measured": measured,
        "algorithm": "inverse_dynamics",
    }
    if joint.is_learning:
        return synthetic.message_of(
            joint, FaultEstimate, now_ns, **common, verdict=FaultEstimate.REFUSED, valid=False,
            lacks_calibration=True, reason=_progress(joint), reason_codes=["learning"],
        )  # fmt: skip
    quantities = _quantities(joint)
    friction = max(quantities[0].change, 0.0) / _FRICTION.slope
    has_departed = any(quantity.judgement == QuantityChange.CHANGED for quantity in quantities)
    covariance = np.full((8, 8), math.nan)
    covariance[0, 0] = (SIGMA / _FRICTION.slope) ** 2
    return synthetic.message_of(
        joint,
        FaultEstimate,
        now_ns,
        **common,
        faults=FaultVector(**{name: math.nan for name in _FIELDS} | {"friction": friction}),
        covariance=covariance.ravel(),
        unobservable=0xFE,
        insignificant=int(not has_departed),
        quantities=quantities,
        verdict=FaultEstimate.DEPARTED if has_departed else FaultEstimate.VALID,
        valid=True,
        reason="friction differs from the healthy records" if has_departed else "",
        calibration_id=f"{joint.actuator_id} 2031-03-12",
        calibration_windows=joint.records,
    )


def _progress(joint: Joint) -> str:
    return f"learning: {joint.records} records on {min(joint.records, 2)} days; " + (
        joint.reason or "a person accepts the baseline"
    )


def health(joint: Joint, now_ns: int) -> Health:
    level = joint.level_of(joint.tests)
    if joint.is_learning and joint.level is None:
        level = STALE
    value = max(joint.change_at(joint.tests), 0.0) / _FRICTION.slope
    unknown = synthetic.unknown_life("no growth is known")
    names = [name for name, *_ in joint.changed]
    if joint.change > 0.15:
        names.insert(0, "friction")
    causes = {
        WARN: f"{' and '.join(names)} changed (friction warns above +25 %, fails above +50 %)"
    }
    causes[ERROR] = f"friction +{100 * joint.change:.0f} % (warns above +25 %, fails above +50 %)"
    return synthetic.message_of(
        joint,
        Health,
        now_ns,
        level=level,
        last_level=OK if level == STALE and not joint.is_learning else level,
        health_index=math.nan if level == STALE else max(0.0, 1.0 - 4.0 * value),
        confidence=0.0 if level == STALE else 0.8,
        dominant_fault="friction" if level in (WARN, ERROR) and joint.change > 0.15 else "",
        faults=[] if joint.is_learning else [
            FaultHealth(
                name="friction", level=level, value=value, sigma=SIGMA / _FRICTION.slope,
                limit=0.25, trend=math.nan, unit="1", rul=unknown,
            )
        ],
        rul_faults=unknown,
        rul_requirements=unknown,
        rul=unknown,
        flight_hours=math.nan,
        cycles=joint.tests,
        removal_risk=0.05,
        removal_hours=math.nan,
        cause=causes.get(level, ""),
        reason=_progress(joint) if joint.is_learning
        else "no record for three expected periods" if level == STALE else "",
    )  # fmt: skip


def curve(joint: Joint, now_ns: int) -> FrictionCurve:
    """Return the friction curve of the latest record, with increased Coulomb friction."""
    forward = np.linspace(0.08, 1.34, 12)
    speed = np.concatenate([-forward[::-1], forward])
    friction = np.sign(speed) * (0.8 + 0.25 * np.exp(-((speed / 0.2) ** 2))) + 0.3 * speed
    width = 0.06 + 0.04 * np.abs(speed)
    noise = np.random.default_rng(joint.tests).normal(size=len(speed))
    latest = friction + joint.change * 0.9 * np.sign(speed) + 0.02 * noise
    latest[:2] = math.nan
    low, high = friction - width, friction + width
    low[-1] = high[-1] = math.nan
    fields = {"speed": speed, "healthy_low": low, "healthy_high": high, "latest": latest}
    return synthetic.message_of(joint, FrictionCurve, now_ns, unit="N.m", **fields)


def history(joint: Joint, now_ns: int, period_s: float, first: int = 1) -> UnitHistory:
    """Return the history of a joint from record ``first`` on; empty while the joint learns."""
    tests = []
    for number in range(first, joint.tests + 1) if not joint.is_learning else ():
        faults, sigmas = np.full(8, math.nan), np.full(8, math.nan)
        index = FAULT_NAMES.index("friction")
        faults[index] = max(joint.change_at(number), 0.0) / _FRICTION.slope
        sigmas[index] = SIGMA / _FRICTION.slope
        tests.append(
            UnitTest(
                stamp=stamp_to_message(
                    now_ns - int((joint.tests - number) * period_s * synthetic.NS)
                ),
                flight_hours=math.nan,
                cycles=number,
                faults=faults,
                sigmas=sigmas,
                insignificant=int(faults[index] * _FRICTION.slope < 3.0 * SIGMA),
                level=joint.level_of(number),
                health_index=math.nan,
                rul_05=math.nan,
                rul_50=math.nan,
                rul_95=math.nan,
            )
        )
    events = [
        UnitEvent(
            stamp=stamp_to_message(now_ns - 100 * synthetic.NS),
            flight_hours=math.nan,
            kind="calibration",
            text=f"baseline accepted by {joint.author}",
        )
    ]
    return synthetic.message_of(
        joint, UnitHistory, now_ns, tests=tests, events=[] if joint.is_learning else events
    )


def change_baseline(joint: Joint, request: ChangeBaseline.Request) -> None:
    """Change a baseline as a monitor does.

    Raises
    ------
    ValueError
        If a monitor would refuse the change.
    """
    prefix = "/ema/monitor/change_baseline: "
    if request.change == ChangeBaseline.Request.ACCEPT:
        if joint.reason:
            raise ValueError(f"{prefix}{joint.reason}")
        if joint.needed and not request.force:
            raise ValueError(f"{prefix}record 3 differs from the others: repair it, or set force")
        joint.author = request.person
    elif request.change == ChangeBaseline.Request.EXTEND:
        joint.records += 5
    else:
        joint.author, joint.records, joint.reason = "", 0, ""
