"""Estimates and health as messages."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.description import ActuatorDescription
from ema_interfaces.msg import FaultEstimate, RemainingUsefulLife
from ema_interfaces.msg import FaultHealth as FaultHealthMessage
from ema_interfaces.msg import Health as HealthMessage
from ema_messages.faults import faults_to_message
from ema_messages.stamps import stamp_to_message
from ema_monitor.estimate import Estimate
from ema_monitor.health import Health
from ema_monitor.window import MIN_TRAVEL

_NO_PROGNOSIS: Final = "no prognosis is made"


def estimate_to_message(
    estimate: Estimate, window: int, description: ActuatorDescription
) -> FaultEstimate:
    """Return an estimate as a message.

    Parameters
    ----------
    estimate
        What was found.
    window
        Running number of the window.
    description
        The actuator.

    Raises
    ------
    ValueError
        When a stamp is out of range.
    """
    message = FaultEstimate(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        window=int(window),
        faults=faults_to_message(estimate.faults),
        unobservable=_bits(estimate.unobservable),
        insignificant=_bits(estimate.insignificant),
        play_offset=float(estimate.play),
        fitness=float(estimate.fitness),
        goodness_of_fit=float(estimate.goodness_of_fit),
        goodness_limit=float(estimate.goodness_limit),
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
    message.window_start = stamp_to_message(estimate.start_ns)
    message.window_end = stamp_to_message(estimate.end_ns)
    message.header.stamp = message.window_end
    message.covariance = estimate.covariance.astype(np.float64).ravel()
    return message


def _bits(components: NDArray[np.bool_]) -> int:
    return int(np.packbits(components, bitorder="little")[0])


def health_to_message(
    health: Health, stamp_ns: int, windows: int, description: ActuatorDescription
) -> HealthMessage:
    """Return health as a message; the remaining useful life in it is unknown.

    Parameters
    ----------
    health
        The health.
    stamp_ns
        End of the window on which it rests [ns].
    windows
        Test windows seen so far.
    description
        The actuator.

    Raises
    ------
    ValueError
        When the stamp is out of range.
    """
    message = HealthMessage(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        level=health.level,
        health_index=health.health_index,
        severity=health.severity,
        confidence=health.confidence,
        dominant_fault=health.dominant_fault,
        rul_faults=_unknown_life(""),
        rul_requirements=_unknown_life(""),
        rul=_unknown_life(""),
        flight_hours=float("nan"),
        cycles=windows,
        duty=1.0,
        assumption="future use is like that of the past",
        reason=health.reason,
    )
    message.header.stamp = stamp_to_message(stamp_ns)
    message.faults = [
        FaultHealthMessage(
            name=item.name,
            level=item.level,
            value=item.value,
            sigma=item.sigma,
            limit=item.limit,
            limit_is_lower=item.limit_is_lower,
            trend=float("nan"),
            unit="1",
            rul=_unknown_life(f"{item.name} limit {item.limit:g}"),
        )
        for item in health.faults
    ]
    return message


def _unknown_life(criterion: str) -> RemainingUsefulLife:
    nan = float("nan")
    return RemainingUsefulLife(
        known=False,
        hours_05=nan,
        hours_50=nan,
        hours_95=nan,
        cycles_05=nan,
        cycles_50=nan,
        cycles_95=nan,
        criterion=criterion,
        reason=_NO_PROGNOSIS,
    )
