"""Estimates and health as messages."""

import math
from array import array
from dataclasses import is_dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.levels import STALE
from ema_interfaces.msg import Advice as AdviceMessage
from ema_interfaces.msg import (
    FaultEstimate,
    FaultForecast,
    HealthForecast,
    HiddenCause,
    UnitHistory,
    UnitTest,
)
from ema_interfaces.msg import Health as HealthMessage
from ema_interfaces.msg import UnitEvent as UnitEventMessage
from ema_interfaces.msg import WindowFit as WindowFitMessage
from ema_monitor.identification.estimate import VERDICTS, Estimate
from ema_monitor.identification.window_fit import WindowFit
from ema_monitor.prognosis.advice import Advice
from ema_monitor.prognosis.forecaster import LEVELS, Forecaster
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.reports import EventReport, health_report
from ema_monitor.unit import KnownTest
from ema_monitor.windows.window import MIN_TRAVEL
from ema_ros.messages import faults_to_message
from ema_ros.stamps import check_stamp, stamp_to_message

_PLAIN = {"double": float, "boolean": bool, "string": str}
"""What sets a field of these kinds; others are whole numbers."""

_ACTIONS = {
    "unknown": AdviceMessage.UNKNOWN,
    "continue": AdviceMessage.CONTINUE,
    "inspect": AdviceMessage.INSPECT,
    "remove": AdviceMessage.REMOVE,
}


def estimate_to_message(
    estimate: Estimate, window: int, description: ActuatorDescription
) -> FaultEstimate:
    """Return the estimate of a window of a running number as a message.

    Raises
    ------
    ValueError
        When a stamp is out of range.
    """
    message = FaultEstimate(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        window=int(window),
        window_start=stamp_to_message(estimate.start_ns),
        window_end=stamp_to_message(estimate.end_ns),
        stretches=int(estimate.stretches),
        covariance=estimate.covariance.astype(np.float64).ravel(),
        faults=faults_to_message(estimate.faults),
        unobservable=_bits(estimate.unobservable),
        insignificant=_bits(estimate.insignificant),
        play_offset=float(estimate.play),
        fitness=float(estimate.fitness),
        goodness_of_fit=float(estimate.goodness_of_fit),
        goodness_limit=float(estimate.goodness_limit),
        unexplained_share=float(estimate.unexplained_share),
        hidden_causes=[_hidden_cause(cause, estimate) for cause in estimate.causes],
        measured_causes=[_hidden_cause(cause) for cause in estimate.measured],
        confusions=[" or ".join(pair) for pair in estimate.alternatives],
        verdict=VERDICTS.index(estimate.verdict),
        excitation=float(estimate.excitation),
        excitation_limit=MIN_TRAVEL,
        algorithm=estimate.algorithm,
        seed=int(estimate.seed),
        evaluations=int(estimate.evaluations),
        warm_start=bool(estimate.warm_start),
        computing_time=float(estimate.computing_time_s),
        calibration_id=estimate.calibration_id,
        calibration_windows=int(estimate.calibration_windows),
        valid=bool(estimate.valid),
        reason=estimate.reason,
    )
    message.header.stamp = message.window_end
    return message


def _hidden_cause(one: CauseEstimate, estimate: Estimate | None = None) -> HiddenCause:
    """Return a cause as a message, of an estimate with what else could stand in for it."""
    cause = CAUSE_BY_NAME[one.name]
    pairs = estimate.alternatives if estimate else ()
    others = [other for label, other in pairs if label == cause.label]
    return HiddenCause(
        name=one.name, value=one.value, sigma=one.sigma, unit=cause.unit, alternatives=others
    )


def _bits(components: NDArray[np.bool_]) -> int:
    return int(np.packbits(components, bitorder="little")[0])


def health_to_message(outlook: Outlook, description: ActuatorDescription) -> HealthMessage:
    """Return health and remaining life as a message.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    check_stamp(outlook.stamp_ns)
    return message_of(HealthMessage, health_report(outlook, description))


def message_of(message_class: Any, report: Any) -> Any:
    """Return a report as the message that has its fields."""
    message = message_class()
    kinds = message_class.get_fields_and_field_types()
    for name, value in vars(report).items():
        setattr(message, name, _field(kinds[name], value))
    return message


def _field(kind: str, value: Any) -> Any:
    """Return a value of a report as a field of a message is set; its kind is as ROS names it."""
    if isinstance(value, tuple):
        one = kind.removeprefix("sequence<").removesuffix(">")
        return [_field(one, item) for item in value]
    if is_dataclass(value):
        package, _, name = kind.partition("/")
        return message_of(getattr(import_module(f"{package}.msg"), name), value)
    return _PLAIN.get(kind, int)(value)


def forecast_to_message(forecaster: Forecaster, description: ActuatorDescription) -> HealthForecast:
    """Return the forecast of the faults as a message; without faults when hours are unknown.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    outlook, fan = forecaster.outlook, forecaster.fan()
    message = HealthForecast(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        flight_hours=float(outlook.hours),
        duty=float(outlook.duty),
        probabilities=array("d", LEVELS),
    )
    message.header.stamp = stamp_to_message(outlook.stamp_ns)
    if fan is not None:
        message.hours = array("d", fan.hours)
        message.faults = [
            FaultForecast(
                name=name,
                limit=float(forecaster.limits.of(name)),
                values=array("d", values.ravel()),
            )
            for name, values in fan.values.items()
        ]
    return message


def advice_to_message(
    advice: Advice, outlook: Outlook, cost_unit: str, description: ActuatorDescription
) -> AdviceMessage:
    """Return an advice as a message; ``outlook`` is what it rests on.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    message = AdviceMessage(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        action=_ACTIONS[advice.action],
        flight_hours=float(advice.hours),
        from_now=float(advice.from_now),
        probability_of_failure=float(advice.probability),
        expected_cost=float(advice.rate),
        cost_of_immediate_removal=float(advice.rate_at_once),
        cost_unit=cost_unit,
        reason=advice.reason,
    )
    message.header.stamp = stamp_to_message(outlook.stamp_ns)
    return message


def window_fit_to_message(
    fit: WindowFit, estimate: Estimate, window: int, description: ActuatorDescription
) -> WindowFitMessage:
    """Return a window beside the model's response as a message.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    message = WindowFitMessage(
        actuator_id=description.actuator_id,
        window=int(window),
        verdict=VERDICTS.index(estimate.verdict),
        period=float(fit.period),
        start=float(fit.start),
        command=array("f", fit.command),
        position=array("f", fit.position),
        current=array("f", fit.current),
        estimated_current=array("f", fit.estimated_current),
        speed=array("f", fit.speed),
        estimated_speed=array("f", fit.estimated_speed),
    )
    message.header.stamp = stamp_to_message(estimate.end_ns)
    return message


def history_to_message(
    tests: list[KnownTest], omitted: int, description: ActuatorDescription
) -> UnitHistory:
    """Return the latest tests of a unit as a message; ``omitted`` earlier ones are known.

    Raises
    ------
    ValueError
        When a stamp is out of range.
    """
    message = UnitHistory(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        tests=[_unit_test(test) for test in tests],
        events=[
            message_of(UnitEventMessage, EventReport.of(event))
            for test in tests
            for event in (test.assessment.events if test.assessment else ())
        ],
        omitted=int(omitted),
    )
    if tests:
        message.header.stamp = stamp_to_message(tests[-1].entry.stamp_ns)
    return message


def _unit_test(test: KnownTest) -> UnitTest:
    estimate, found = test.entry.estimate, test.assessment
    unobservable = estimate.unobservable
    life = (found.life if found else None) or (math.nan,) * 3
    return UnitTest(
        stamp=stamp_to_message(estimate.end_ns),
        flight_hours=float(test.hours),
        cycles=int(test.entry.cycles),
        verdict=VERDICTS.index(estimate.verdict),
        faults=np.where(unobservable, np.nan, np.array(estimate.faults)),
        sigmas=np.where(unobservable, np.nan, np.array(estimate.sigma)),
        insignificant=_bits(estimate.insignificant),
        level=found.level if found else STALE,
        health_index=float(found.health_index) if found else math.nan,
        dominant_fault=found.dominant_fault if found else "",
        rul_known=bool(found and found.life),
        rul_05=float(life[0]),
        rul_50=float(life[1]),
        rul_95=float(life[2]),
    )
