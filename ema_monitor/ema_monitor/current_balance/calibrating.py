"""Calibrating a unit whose drive is unknown, on healthy motion (M44)."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from ema_core.description import ActuatorDescription
from ema_monitor.current_balance.balance import OF_CURRENT, Balance, ripples
from ema_monitor.current_balance.fitting import BalancePrior, Fit, basic_terms, fit, loads_before
from ema_monitor.current_balance.motion import has_speed
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.windows.window import Window

_KNEE: Final = 0.15
_KNEE_WITHOUT_SPEED: Final = 0.2
_FEWEST_ROWS: Final = 30
_LEAST_NOISE: Final = 1e-4
_SMALL: Final = 0.1
_VISCOUS: Final = 0.5
_SMALL_SHARE: Final = 0.02


def calibrate_unknown(
    windows: Sequence[Window], description: ActuatorDescription
) -> UnknownDriveUnit:
    """Find inertia, friction, play and what repeats with the angle on healthy motion.

    Parameters
    ----------
    windows
        Healthy windows of any motion, at least one. Loads that were measured are taken for known.
    description
        The unit: gear ratio, pole pairs, nominal play, and how its telemetry is acquired. The
        product of torque constant and current is a torque only where the torque constant is given;
        nothing depends on it.

    Raises
    ------
    ValueError
        When there is no window, the motion is too little to tell inertia and friction, or the
        figures are impossible.
    """
    if description.acquisition.current == "none":
        raise ValueError(
            "drive = unknown needs a measured current: acquisition says that there is none"
        )
    if not windows:
        raise ValueError("calibration needs at least one healthy window, got none")
    h = windows[0].sample_period
    # One window after the other: they may be read when needed.
    strong = []
    for number, window in enumerate(windows):
        if defect := motion_defect(window, description):
            raise ValueError(f"window {number}: {defect.reason}")
        if abs(window.sample_period / h - 1.0) > 1e-6:
            raise ValueError(
                f"window {number}: the sample period is {window.sample_period:g} s, in the "
                f"first one {h:g} s"
            )
        strong.append(float(np.percentile(np.abs(window.current), 95.0)))
    share = _KNEE if description.acquisition.speed else _KNEE_WITHOUT_SPEED
    knee = share * float(np.median(strong))
    if not knee > 0.0:
        raise ValueError("the current is 0 throughout the healthy windows: is it measured?")
    balances = [Balance.of(window.telemetry, description, knee) for window in windows]
    rows = sum(one.rows for one in balances)
    if rows < _FEWEST_ROWS:
        raise ValueError(
            f"the healthy windows have {rows} means of steady motion one way, at least "
            f"{_FEWEST_ROWS} are needed: give longer motion"
        )
    found = _fit(windows, balances, description)
    play, play_sigma = _play(balances)
    load, stiffness = found.loads.mean(axis=0).tolist()
    return UnknownDriveUnit(
        actuator_id=description.actuator_id,
        serial_number=description.serial_number,
        parameters=description.parameters,
        sample_period=h,
        speed_measured=description.acquisition.speed,
        windows=len(windows),
        terms=found.values,
        covariance=found.covariance,
        load=load,
        stiffness=stiffness,
        knee=knee,
        noise=max(found.rms, _LEAST_NOISE),
        play=play,
        play_sigma=play_sigma,
        fastest=max(one.fastest for one in balances),
    )


class MotionDefect(NamedTuple):
    """Why nothing can be told from a motion, and whether that is a failure of the unit."""

    reason: str
    is_failure: bool = False


def motion_defect(window: Window, description: ActuatorDescription) -> MotionDefect | None:
    """Return why nothing can be told from the motion of a window; None when something can."""
    telemetry = window.telemetry
    if not len(telemetry.current):
        return MotionDefect("drive = unknown needs a measured current, and the telemetry has none")
    measured = has_speed(telemetry, description)
    if measured != description.acquisition.speed:
        return MotionDefect("the speed is not measured, although the description says so")
    if np.any(telemetry.speed) if measured else np.ptp(telemetry.position) > 0.0:
        return None
    if not np.ptp(telemetry.command) > 0.0:
        return MotionDefect("no excitation: the motor stands still")
    flows = float(np.median(np.abs(telemetry.current)))
    reason = (
        f"no excitation: the motor stands still although the command moves and {flows:.2g} "
        "A flow; a blocked shaft, an open phase or a frozen sensor"
    )
    return MotionDefect(reason, is_failure=True)


def _play(balances: Sequence[Balance]) -> tuple[float, float]:
    """Return the play of the healthy unit and its sigma [rad]; NaN where no motion shows it."""
    plays = [one.play for one in balances if one.play is not None]
    if not plays:
        return math.nan, math.nan
    weights = np.array([1.0 / max(one.sigma, 1e-9) ** 2 for one in plays])
    widths = np.array([one.width for one in plays])
    play = float(weights @ widths / weights.sum())
    if not play > 0.0:  # no play: what was seen is the lag of the drive, or the sensors'
        return math.nan, math.nan
    scatter = float(np.std(widths)) / math.sqrt(max(1, len(plays) - 1))
    return play, max(float(weights.sum() ** -0.5), scatter if len(plays) > 1 else 0.0)


def _fit(
    windows: Sequence[Window], balances: Sequence[Balance], description: ActuatorDescription
) -> Fit:
    """Fit the terms, without knowing anything of the unit."""
    size = balances[0].design.shape[1]
    moving = [np.abs(one.current[one.weight > 0.0]) for one in balances]
    usual = float(np.median(np.concatenate(moving)))
    fastest = max(one.fastest for one in balances)
    accelerations = np.concatenate([np.abs(one.design[:, 0]) for one in balances])
    sigma = np.full(size, usual)
    sigma[0] = 1e3 * usual / max(float(np.percentile(accelerations, 90.0)), 1e-9)
    sigma[1] = 1e3 * usual
    sigma[2] = usual / fastest
    sigma[3] = 0.5 * usual
    sigma[4] = 3e-3
    loads = loads_before(windows, balances, description.parameters)
    prior = BalancePrior(np.zeros(size), sigma, *loads)
    basic = basic_terms(prior)
    first = fit(balances, prior, basic, 1e-6 * usual)
    # What no motor is free of; left out, it would be taken for friction where the motor turns
    # less than once.
    small = np.full(size, _SMALL * abs(first.values[1]))
    sigma[3] = _SMALL * abs(first.values[1])
    sigma[2] = _VISCOUS * abs(first.values[1]) / fastest
    for ripple in ripples(description.parameters.P).values():
        if ripple.scales_with == OF_CURRENT:
            small[ripple.terms] = _SMALL_SHARE
    sigma = np.where(basic, sigma, small)
    noise = max(first.rms, _LEAST_NOISE)
    return fit(balances, replace(prior, sigma=sigma), np.ones(size, dtype=bool), noise)
