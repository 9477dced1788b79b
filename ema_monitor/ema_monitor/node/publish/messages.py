# SPDX-License-Identifier: Apache-2.0
"""Conversion of results to ROS messages; a stamp out of range raises ValueError."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import is_dataclass
from importlib import import_module
from typing import Any, Final

import numpy as np

from ema_core.arrays import Flags
from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.faults import N_FAULTS
from ema_core.labels import label_of
from ema_core.levels import LEVEL_NAMES
from ema_interfaces.msg import Advice as AdviceMessage
from ema_interfaces.msg import (
    BaselineStatus,
    Confusion,
    FaultEstimate,
    FaultForecast,
    HealthForecast,
    HealthSummary,
    HiddenCause,
    QuantityChange,
    UnitHistory,
    UnitTest,
)
from ema_interfaces.msg import FrictionCurve as FrictionCurveMessage
from ema_interfaces.msg import Health as HealthMessage
from ema_interfaces.msg import WindowFit as WindowFitMessage
from ema_monitor.baselines.progress import BaselineProgress
from ema_monitor.baselines.unit_baseline import UnitBaseline
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.diagnosis import Diagnosed
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.identification.window_fit import WindowFit
from ema_monitor.joint.comparison import JUDGEMENTS, Comparison
from ema_monitor.joint.curve import FrictionCurve
from ema_monitor.prognosis.advice import Advice
from ema_monitor.prognosis.duty.scenario import Scenario, scenarios_of
from ema_monitor.prognosis.forecaster import Forecaster
from ema_monitor.prognosis.growth.prediction import FAN_LEVELS
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.reasons import codes
from ema_monitor.reports import EventReport, health_report
from ema_monitor.unit import KnownTest
from ema_monitor.windows.window import MIN_TRAVEL
from ema_ros.messages import faults_to_message
from ema_ros.stamps import check_stamp, stamp_to_message

_PLAIN = {"double": float, "boolean": bool, "string": str}
"""Conversion by ROS field type; fields of any other type are integers."""


def estimate_to_message(
    estimate: Estimate, window: int, description: ActuatorDescription
) -> FaultEstimate:
    """Return the estimate of window number ``window`` as a message."""
    return _filled_message(
        FaultEstimate,
        description,
        estimate,
        stamp_ns=estimate.end_ns,
        window=window,
        window_start=stamp_to_message(estimate.start_ns),
        window_end=stamp_to_message(estimate.end_ns),
        faults=faults_to_message(estimate.faults),
        unobservable=fault_bits(FaultEstimate, "unobservable", estimate.unobservable),
        insignificant=fault_bits(FaultEstimate, "insignificant", estimate.insignificant),
        causes=[_hidden_cause(cause) for cause in estimate.causes],
        measured=[_hidden_cause(cause) for cause in estimate.measured],
        quantities=_quantities(estimate.comparison),
        alternatives=[Confusion(**pair.as_record()) for pair in estimate.alternatives],
        verdict=tuple(Verdict).index(estimate.verdict),
        excitation_limit=MIN_TRAVEL,
        reason_codes=list(codes(estimate.reasons)),
    )


def _quantities(comparison: Comparison | None) -> list[QuantityChange]:
    return [
        _filled_message(
            QuantityChange,
            quantity,
            judgement=JUDGEMENTS.index(quantity.judgement),
            reason_codes=list(codes(quantity.reasons)),
        )
        for quantity in (comparison.quantities if comparison else ())
    ]


def _hidden_cause(inferred: CauseEstimate) -> HiddenCause:
    return _filled_message(HiddenCause, CAUSE_BY_NAME[inferred.name], inferred)


def fault_bits(message_class: Any, name: str, components: Flags) -> int:
    """Return a message's bit field with one bit for each component of the fault vector, ``(n,)``.

    Raises
    ------
    ValueError
        If the field has fewer bits than there are components.
    """
    kind = message_class.get_fields_and_field_types()[name]
    if components.size > int(kind.removeprefix("uint")):
        raise ValueError(
            f"{message_class.__name__}.{name} is {kind}: expected a bit for each of "
            f"{components.size} faults; widen the field in {message_class.__name__}.msg and run "
            "make setup"
        )
    return sum(1 << int(number) for number in np.flatnonzero(components))


_ALL: Final = np.ones(N_FAULTS, dtype=np.bool_)
# Computed at import: a fault without a bit is reported at once.
_ALL_UNOBSERVABLE: Final = fault_bits(FaultEstimate, "unobservable", _ALL)
fault_bits(FaultEstimate, "insignificant", _ALL)
fault_bits(UnitTest, "insignificant", _ALL)


def health_to_message(outlook: Outlook, description: ActuatorDescription) -> HealthMessage:
    """Return health and remaining life as a message."""
    check_stamp(outlook.stamp_ns)
    return message_of(HealthMessage, health_report(outlook, description.unit_key))


def message_of(message_class: Any, report: Any) -> Any:
    """Return a report as a message; the report must have the fields of the class."""
    return _filled_message(message_class, report)


def _filled_message(
    message_class: Any, *sources: Any, stamp_ns: int | None = None, **values: Any
) -> Any:
    """Return a message filled from attributes of ``sources`` and from ``values`` by field name."""
    message, kinds = message_class(), message_class.get_fields_and_field_types()
    copied = {
        name: getattr(source, name) for source in sources for name in kinds if hasattr(source, name)
    }
    for name, value in (copied | values).items():
        setattr(message, name, _field(kinds[name], value))
    if stamp_ns is not None:
        message.header.stamp = stamp_to_message(stamp_ns)
    return message


def _field(kind: str, value: Any) -> Any:
    """Return a value converted to the type of a message field; ``kind`` is the ROS type."""
    if (plain := _PLAIN.get(kind)) is not None:
        return plain(value)
    if isinstance(value, np.ndarray):
        # Fields of fixed length are NumPy arrays.
        if kind.endswith("]"):
            return value.astype(np.float64).ravel()
        return array("f" if "float" in kind else "d", value.ravel())
    if isinstance(value, tuple):
        item_kind = kind.removeprefix("sequence<").removesuffix(">")
        return [_field(item_kind, item) for item in value]
    if is_dataclass(value):
        package, _, name = kind.partition("/")
        return message_of(getattr(import_module(f"{package}.msg"), name), value)
    if isinstance(value, list) or "/" in kind:
        return value
    return int(value)


def forecast_to_message(forecaster: Forecaster, description: ActuatorDescription) -> HealthForecast:
    """Return the fault forecast as a message; without faults if service hours are unknown."""
    outlook, fan = forecaster.outlook, forecaster.fan()
    return _filled_message(
        HealthForecast,
        description,
        fan,
        stamp_ns=outlook.stamp_ns,
        flight_hours=outlook.flight_hours,
        growth_factor=outlook.future.factor,
        probabilities=np.array(FAN_LEVELS),
        faults=[
            _filled_message(
                FaultForecast, name=name, limit=forecaster.limits.of(name), values=values
            )
            for name, values in (fan.values.items() if fan else ())
        ],
    )


def advice_to_message(
    advice: Advice, outlook: Outlook, cost_unit: str, description: ActuatorDescription
) -> AdviceMessage:
    """Return the removal advice computed from ``outlook`` as a message."""
    return _filled_message(
        AdviceMessage,
        description,
        advice,
        stamp_ns=outlook.stamp_ns,
        action=getattr(AdviceMessage, advice.action.upper()),
        cost_unit=cost_unit,
    )


def window_fit_to_message(fit: WindowFit, diagnosed: Diagnosed) -> WindowFitMessage:
    """Return the signals of a window, measured and modelled, as a message."""
    verdict = tuple(Verdict).index(diagnosed.estimate.verdict)
    return _filled_message(
        WindowFitMessage,
        diagnosed.description,
        fit,
        stamp_ns=diagnosed.estimate.end_ns,
        window=diagnosed.number,
        verdict=verdict,
    )


def history_to_message(
    tests: list[KnownTest], omitted: int, description: ActuatorDescription
) -> UnitHistory:
    """Return the latest tests of a unit as a message; ``omitted`` counts its earlier tests."""
    return _filled_message(
        UnitHistory,
        description,
        stamp_ns=tests[-1].entry.end_ns if tests else None,
        tests=[_unit_test(test) for test in tests],
        events=tuple(
            EventReport.of(event)
            for test in tests
            for event in (test.assessment.events if test.assessment else ())
        ),
        omitted=omitted,
    )


def _unit_test(test: KnownTest) -> UnitTest:
    estimate, assessment = test.entry.estimate, test.assessment
    unobservable = estimate.unobservable
    life = (assessment.life if assessment else None) or (math.nan,) * 3
    return _filled_message(
        UnitTest,
        test.entry,
        assessment,
        stamp=stamp_to_message(test.entry.end_ns),
        flight_hours=test.hours,
        verdict=tuple(Verdict).index(estimate.verdict),
        faults=np.where(unobservable, np.nan, np.array(estimate.faults)),
        sigmas=np.where(unobservable, np.nan, np.array(estimate.sigma)),
        insignificant=fault_bits(UnitTest, "insignificant", estimate.insignificant),
        health_index=assessment.health_index if assessment else math.nan,
        rul_known=bool(assessment and assessment.life),
        rul_05=life[0],
        rul_50=life[1],
        rul_95=life[2],
    )


def baseline_to_message(
    baseline: UnitBaseline, progress: BaselineProgress, stamp_ns: int
) -> BaselineStatus:
    """Return the status of a learned baseline after its latest record."""
    accepted, calibration = baseline.accepted_by, baseline.calibration
    return _filled_message(
        BaselineStatus,
        baseline.description,
        progress,
        stamp_ns=stamp_ns,
        state=BaselineStatus.ACCEPTED if calibration else BaselineStatus.LEARNING,
        calibration_id=calibration.calibration_id if calibration else "",
        author=accepted.author if accepted else "",
        accepted=stamp_to_message(accepted.time_ns if accepted else 0),
    )


def curve_to_message(
    curve: FrictionCurve, diagnosed: Diagnosed, calibration: JointCalibration
) -> FrictionCurveMessage:
    """Return the friction curve of a record as a message, in the recorded units."""
    unit, scale = calibration.effort_shown
    lead = calibration.parameters.lead
    travel_per_radian = lead / (2.0 * math.pi) if lead else 1.0
    efforts = {name: scale * getattr(curve, name) for name in curve._fields[1:]}
    return _filled_message(
        FrictionCurveMessage,
        diagnosed.description,
        stamp_ns=diagnosed.estimate.end_ns,
        unit=unit,
        speed=travel_per_radian * curve.speed,
        **efforts,
    )


def summary_of(health: HealthMessage) -> HealthSummary:
    """Return the summary of a health message."""
    life = health.rul.hours_50 if health.rul.known else math.nan
    text = LEVEL_NAMES[health.level]
    if health.dominant_fault:
        text += f": {label_of(health.dominant_fault)}"
    parts = [text]
    if math.isfinite(life):
        parts.append(f"remaining life {life:.4g} service hours")
    if health.reason:
        parts.append(health.reason)
    return _filled_message(HealthSummary, health, rul_50=life, text="; ".join(parts))


def unknown_estimate(actuator_id: str, reason: str) -> FaultEstimate:
    """Return an estimate message for a failed call: all its floating-point numbers are NaN."""
    message = _without_figures(FaultEstimate())
    message.actuator_id, message.reason = actuator_id, reason
    message.verdict, message.unobservable = FaultEstimate.REFUSED, _ALL_UNOBSERVABLE
    return message


def unknown_health(actuator_id: str, reason: str) -> HealthMessage:
    """Return a health message for a failed call: all its floating-point numbers are NaN."""
    message = _without_figures(HealthMessage())
    message.actuator_id, message.reason = actuator_id, reason
    message.level = HealthMessage.STALE
    for life in (message.rul, message.rul_faults, message.rul_requirements):
        life.reason = reason
    return message


def _without_figures(message: Any) -> Any:
    """Return a message with NaN in each floating-point field, also in nested messages."""
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        if isinstance(value, float):
            setattr(message, name, math.nan)
        elif hasattr(value, "dtype"):
            value[:] = math.nan
        elif isinstance(value, array) and value.typecode == "d":
            setattr(message, name, array("d", [math.nan] * len(value)))
        elif hasattr(value, "get_fields_and_field_types"):
            _without_figures(value)
    return message


def scenarios_from_messages(messages: Sequence[Any]) -> tuple[Scenario, ...]:
    """Return the scenarios of ``ema_interfaces/msg/DutyScenario`` messages.

    Raises
    ------
    ValueError
        If a scenario is impossible, if the numbers of values and shares differ, or if a value is
        repeated.
    """
    return scenarios_of(
        [
            {
                "name": message.name,
                "duty": message.duty,
                "travel_per_hour": message.travel_per_hour,
                "loads": _shares("loads", message.loads, message.load_shares),
                "winding": _shares("winding", message.winding_temperatures, message.winding_shares),
                "hours_per_cycle": message.hours_per_cycle,
                "hours_per_day": message.hours_per_day,
            }
            for message in messages
        ]
    )


def _shares(name: str, values: Sequence[float], shares: Sequence[float]) -> dict[float, float]:
    if len(values) != len(shares):
        raise ValueError(
            f"{name}: {len(shares)} shares for {len(values)} values: expected one share per value"
        )
    if len(set(values)) < len(values):
        raise ValueError(f"{name} = {list(values)[:10]}: expected different values")
    return dict(zip(values, shares, strict=True))
