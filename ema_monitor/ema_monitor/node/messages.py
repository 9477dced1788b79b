"""What a monitor publishes and answers, as messages; a stamp out of range is a ValueError."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import is_dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.levels import LEVEL_NAMES, STALE
from ema_interfaces.msg import Advice as AdviceMessage
from ema_interfaces.msg import (
    FaultEstimate,
    FaultForecast,
    HealthForecast,
    HealthSummary,
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
from ema_monitor.prognosis.duty.scenario import MOST_SCENARIOS, Scenario, check_scenarios
from ema_monitor.prognosis.forecaster import LEVELS, Forecaster
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.reports import EventReport, health_report
from ema_monitor.unit import KnownTest
from ema_monitor.windows.window import MIN_TRAVEL
from ema_ros.messages import faults_to_message
from ema_ros.stamps import check_stamp, stamp_to_message

_PLAIN = {"double": float, "boolean": bool, "string": str}
"""What sets a field of these kinds; others are whole numbers."""

_ALL = 255
"""Each fault has its bit."""


def estimate_to_message(
    estimate: Estimate, window: int, description: ActuatorDescription
) -> FaultEstimate:
    """Return the estimate of a window of a running number as a message."""
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
    """Return health and remaining life as a message."""
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
    """Return the forecast of the faults as a message; without faults when hours are unknown."""
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
    """Return an advice as a message; ``outlook`` is what it rests on."""
    message = AdviceMessage(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        action=getattr(AdviceMessage, advice.action.upper()),
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
    """Return a window beside the model's response as a message."""
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
    """Return the latest tests of a unit as a message; ``omitted`` earlier ones are known."""
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


def summary_of(health: HealthMessage) -> HealthSummary:
    """Return a health in a few lines."""
    life = health.rul.hours_50 if health.rul.known else math.nan
    words = LEVEL_NAMES[health.level]
    if health.dominant_fault:
        words += f": {health.dominant_fault.replace('_', ' ')}"
    parts = [words]
    if math.isfinite(life):
        parts.append(f"remaining life {life:.4g} flight hours")
    if health.reason:
        parts.append(health.reason)
    return HealthSummary(
        header=health.header,
        actuator_id=health.actuator_id,
        serial_number=health.serial_number,
        level=health.level,
        last_level=health.last_level,
        good_until=health.good_until,
        author=health.author,
        health_index=health.health_index,
        dominant_fault=health.dominant_fault,
        rul_50=life,
        text="; ".join(parts),
    )


def unknown_estimate(actuator_id: str, reason: str) -> FaultEstimate:
    """Return the estimate of an answer that has none: every figure is NaN."""
    message = _without_figures(FaultEstimate())
    message.actuator_id, message.reason = actuator_id, reason
    message.verdict, message.unobservable = FaultEstimate.REFUSED, _ALL
    return message


def unknown_health(actuator_id: str, reason: str) -> HealthMessage:
    """Return the health of an answer that has none: every figure is NaN."""
    message = _without_figures(HealthMessage())
    message.actuator_id, message.reason = actuator_id, reason
    message.level = HealthMessage.STALE
    for life in (message.rul, message.rul_faults, message.rul_requirements):
        life.reason = reason
    return message


def _without_figures(message: Any) -> Any:
    """Return a message with NaN in each floating-point field, those of its parts included."""
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
        When there are too many, or one is impossible; the message names it, its key and value.
    """
    if len(messages) > MOST_SCENARIOS:
        raise ValueError(f"{len(messages)} scenarios: expected at most {MOST_SCENARIOS}")
    return check_scenarios(tuple(_scenario(*one) for one in enumerate(messages, 1)))


def _scenario(number: int, message: Any) -> Scenario:
    try:
        return Scenario(
            message.name,
            message.duty,
            message.travel_per_hour,
            _shares("loads", message.loads, message.load_shares),
            _shares("winding", message.winding_temperatures, message.winding_shares),
            message.hours_per_cycle,
            message.hours_per_day,
        )
    except ValueError as error:
        raise ValueError(f"scenario {number}: {error}") from error


def _shares(name: str, values: Sequence[float], shares: Sequence[float]) -> dict[float, float]:
    if len(values) != len(shares):
        raise ValueError(f"{name}: {len(shares)} shares of {len(values)} values: expected as many")
    if len(set(values)) < len(values):
        raise ValueError(f"{name} = {list(values)[:10]}: expected each value once")
    return dict(zip(values, shares, strict=True))
