"""Estimates and health as messages."""

import math
from array import array
from dataclasses import asdict

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
    RemainingUsefulLife,
    UnitHistory,
    UnitTest,
)
from ema_interfaces.msg import FaultHealth as FaultHealthMessage
from ema_interfaces.msg import Health as HealthMessage
from ema_interfaces.msg import UnitEvent as UnitEventMessage
from ema_interfaces.msg import WindowFit as WindowFitMessage
from ema_monitor.health import FaultHealth
from ema_monitor.identification.estimate import Estimate
from ema_monitor.identification.window_fit import WindowFit
from ema_monitor.prognosis.advice import Advice
from ema_monitor.prognosis.forecaster import LEVELS, Forecaster
from ema_monitor.prognosis.growth.check import Calibration
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.sentences import cause_of_level, reason_of, removal_in_words
from ema_monitor.prognosis.unit_event import UnitEvent
from ema_monitor.unit import KnownTest
from ema_monitor.windows.window import MIN_TRAVEL
from ema_ros.messages import faults_to_message
from ema_ros.stamps import stamp_to_message

_VERDICTS = {
    "valid": FaultEstimate.VALID,
    "degraded": FaultEstimate.DEGRADED,
    "refused": FaultEstimate.REFUSED,
}
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
        verdict=_VERDICTS[estimate.verdict],
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
    health, lives = outlook.health, (outlook.rul_faults, outlook.rul_requirements, outlook.rul)
    rul_faults, rul_requirements, rul = (life_to_message(life, outlook) for life in lives)
    message = HealthMessage(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        level=health.level,
        health_index=float(health.health_index),
        severity=health.severity,
        confidence=float(health.confidence),
        dominant_fault=outlook.dominant,
        faults=[_item(item, "1", outlook) for item in health.faults],
        requirements=[
            _item(item, RequirementLimits.unit(item.name), outlook) for item in health.requirements
        ],
        rul_faults=rul_faults,
        rul_requirements=rul_requirements,
        rul=rul,
        flight_hours=float(outlook.hours),
        cycles=int(outlook.cycles),
        duty=float(outlook.duty),
        assumption=outlook.assumption,
        cause=cause_of_level(outlook),
        removal=removal_in_words(outlook),
        removal_risk=float(outlook.removal.risk),
        removal_hours=float(outlook.removal.hours),
        removal_cycles=float(outlook.removal.cycles),
        removal_days=float(outlook.removal.days),
        events=[_event(event) for event in outlook.events],
        reason=reason_of(outlook),
    )
    message.header.stamp = stamp_to_message(outlook.stamp_ns)
    return message


def _item(item: FaultHealth, unit: str, outlook: Outlook) -> FaultHealthMessage:
    checked = outlook.calibrations.get(item.name, Calibration())
    return FaultHealthMessage(
        name=item.name,
        level=item.level,
        value=float(item.value),
        sigma=float(item.sigma),
        limit=float(item.limit),
        limit_is_lower=bool(item.limit_is_lower),
        trend=float(outlook.trends.get(item.name, math.nan)),
        calibration=float(checked.one_step),
        calibration_ahead=float(checked.ahead),
        widening=float(checked.widening),
        unit=unit,
        rul=life_to_message(outlook.lives.get(item.name, outlook.rul), outlook),
    )


def life_to_message(life: RemainingLife, outlook: Outlook) -> RemainingUsefulLife:
    """Return a remaining life as a message, in flight hours and in test cycles."""
    per_cycle = outlook.hours_per_cycle
    return RemainingUsefulLife(
        **asdict(life),
        cycles_05=life.hours_05 / per_cycle,
        cycles_50=life.hours_50 / per_cycle,
        cycles_95=life.hours_95 / per_cycle,
    )


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
        verdict=_VERDICTS[estimate.verdict],
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
            _event(event)
            for test in tests
            for event in (test.assessment.events if test.assessment else ())
        ],
        omitted=int(omitted),
    )
    if tests:
        message.header.stamp = stamp_to_message(tests[-1].entry.stamp_ns)
    return message


def _event(event: UnitEvent) -> UnitEventMessage:
    return UnitEventMessage(
        stamp=stamp_to_message(event.stamp_ns),
        flight_hours=float(event.hours),
        kind=event.kind,
        text=event.text,
    )


def _unit_test(test: KnownTest) -> UnitTest:
    estimate, found = test.entry.estimate, test.assessment
    unobservable = estimate.unobservable
    life = (found.life if found else None) or (math.nan,) * 3
    return UnitTest(
        stamp=stamp_to_message(estimate.end_ns),
        flight_hours=float(test.hours),
        cycles=int(test.entry.cycles),
        verdict=_VERDICTS[estimate.verdict],
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
