"""Faults of a unit whose drive is unknown, from one motion or several (M45, M46)."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.faults import BACKLASH, ECCENTRICITY, FRICTION, N_FAULTS, FaultVector, healthy_faults
from ema_monitor.current_balance.balance import OF_CURRENT, Balance, Ripple, ripples
from ema_monitor.current_balance.calibrating import MotionDefect, motion_defect
from ema_monitor.current_balance.fitting import (
    BalancePrior,
    Fit,
    evidence,
    fit,
    fit_with_ripples,
    loads_before,
)
from ema_monitor.current_balance.unit import LEARNED, UnknownDriveUnit
from ema_monitor.health import USUAL_TORQUE_CHANGE
from ema_monitor.identification.estimate import CURRENT_DRIVEN, Estimate, refusal
from ema_monitor.identification.settings import MOST_UNEXPLAINED, SearchSettings
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS, UNOBSERVABLE_SIGMA
from ema_monitor.normal.features import motion_of
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

NOT_SEEN: Final = (
    "drive unknown, so that short circuits of single phases, the direction of an eccentricity and "
    "the gain of the position loop are not identified"
)
"""What this form never tells."""

_SIGNIFICANT: Final = 2.68
_CERTAIN: Final = 4.0
_LOSS_MISMATCH: Final = 4e-3
_LOSS_WITHOUT_SPEED: Final = 7e-3
_FRICTION_MISMATCH: Final = (4e-3, 0.015)
_FRICTION_WITHOUT_SPEED: Final = (6e-3, 0.03)
_BACKLASH_MISMATCH: Final = (1.5e-3, 0.0)
_BACKLASH_WITHOUT_SPEED: Final = (4e-3, 0.01)
_BACKLASH_OF_SLOW_RECORDS: Final = (8e-3, 0.12)
_SLOW_S: Final = 4e-3
_ECCENTRICITY_MISMATCH: Final = (0.02, 0.06)
_LOAD_HIDES: Final = 0.4
# How much of the current that a load takes a gear may rub more under it.
_OF_LOAD: Final = 0.5
_OUTSIDE: Final = 1.4
_FEWEST_ROWS: Final = 12
_FREE: Final = 0.5
_LATER_S: Final = 3e-4
# An eccentricity zeta makes ripples of zeta / 2: one wave where currents are sinusoidal, several of
# together 0.92 to 1 of that where they are commutated in six steps, of which two are fitted.
_WAVES: Final = 0.96


def identify_by_current(
    window: Window | Refusal,
    description: ActuatorDescription,
    unit: UnknownDriveUnit,
    settings: SearchSettings,
    *,
    force: bool = False,
) -> Estimate:
    """Return the estimate of a window where nothing is known of the drive, or its refusal.

    Parameters
    ----------
    window, description, unit, settings
        The window or why there is none, its actuator and calibration, and how to identify.
    force
        Make an estimate although the calibration is of another unit.
    """
    if isinstance(window, Refusal):
        return refusal(window, unit, settings, window.reason)
    mismatch = unit.unit_mismatch(description)
    defect = defect_of(window, description, unit, "" if force else mismatch)
    if defect is None:
        caveats = [f"forced although {mismatch}"] if mismatch else []
        found = identify_unknown([window], description, unit, settings.goodness_limit, caveats)
        if isinstance(found, Estimate):
            return found
        defect = MotionDefect(found)
    return refusal(window, unit, settings, defect.reason, is_failure=defect.is_failure)


def defect_of(
    window: Window, description: ActuatorDescription, unit: UnknownDriveUnit, mismatch: str
) -> MotionDefect | None:
    """Return why a window cannot be identified with a calibration that has this mismatch."""
    if reason := unit.shape_mismatch(window):
        return MotionDefect(reason)
    if defect := motion_defect(window, description):
        return defect
    if mismatch:
        return MotionDefect(f"the calibration does not fit: {mismatch}")
    for times, how in zip(_beyond(window, unit), ("fast", "far"), strict=True):
        if not 1.0 / _OUTSIDE <= times <= _OUTSIDE:
            words = f"{times:.2g} times as {how} as the nearest healthy window (limit {_OUTSIDE:g})"
            return MotionDefect(f"outside the calibrated motion: {words}; calibrate on it, too")
    return None


def _beyond(window: Window, unit: UnknownDriveUnit) -> tuple[float, float]:
    return unit.normal.beyond(motion_of(window.telemetry))


def identify_unknown(
    windows: Sequence[Window],
    description: ActuatorDescription,
    unit: UnknownDriveUnit,
    goodness_limit: float,
    caveats: Sequence[str] = (),
) -> Estimate | str:
    """Return the estimate of the faults in motions of one unit, or why there is none.

    Parameters
    ----------
    windows
        At least one, of the same unit; its loads may differ from one to the next.
    description, unit
        The actuator, and its calibration.
    goodness_limit
        Goodness of fit up to which the balance explains the motion.
    caveats
        Reservations to be added to the reason.
    """
    started = time.perf_counter()
    windows = [_with_true_current(window) for window in windows]
    balances = [_balance(window, description, unit) for window in windows]
    rows = sum(one.rows for one in balances)
    if rows < _FEWEST_ROWS:
        return (
            f"too little motion one way: {rows} means of it, at least {_FEWEST_ROWS} are needed; "
            "combine several stretches, or give longer ones"
        )
    said = _Conclusion(windows, balances, unit)
    found = said.found
    goodness = found.rms / unit.noise
    departure = found.rms_before**2 - unit.noise**2
    missed = max(found.rms**2 - unit.noise**2, 0.0)
    share = math.sqrt(missed / departure) if departure > 0.0 else 0.0
    if goodness > goodness_limit and share > MOST_UNEXPLAINED:
        return (
            f"goodness of fit {goodness:.1f} (limit {goodness_limit:.1f}) and {share:.2f} of the "
            "departure from healthy unexplained: neither friction, load nor torque per ampere "
            "explain the current"
        )
    if goodness > goodness_limit:
        said.degraded.append(f"goodness of fit {goodness:.1f}, limit {goodness_limit:.1f}")
    said.conclude(max(1.0, goodness / goodness_limit))
    if np.all(said.unobservable):
        return "; ".join(["no fault is observable", *said.reasons])
    return Estimate(
        start_ns=windows[0].start_ns,
        end_ns=windows[-1].end_ns,
        algorithm=CURRENT_DRIVEN,
        seed=0,
        calibration_id=unit.calibration_id,
        faults=FaultVector.of(np.where(said.unobservable, math.nan, said.faults)),
        covariance=said.covariance,
        unobservable=said.unobservable,
        play=math.nan,
        fitness=found.cost,
        goodness_of_fit=goodness,
        goodness_limit=goodness_limit,
        excitation=max(window.excitation for window in windows),
        evaluations=1,
        computing_time_s=time.perf_counter() - started,
        valid=True,
        reason="; ".join([*said.degraded, *said.reasons, *caveats, NOT_SEEN]),
        insignificant=said.insignificant,
        calibration_windows=unit.windows,
        verdict="degraded" if said.degraded else "valid",
        unexplained_share=share,
        causes=tuple(said.causes),
        alternatives=tuple(said.alternatives),
        stretches=len(windows) if len(windows) > 1 else 0,
        measured=windows[0].measured,
    )


def _with_true_current(window: Window) -> Window:
    """Return a window without the offset and gain of the current sensor that were measured."""
    by_name = {one.name: one.value for one in window.measured}
    gain, offset = by_name.get("current_gain", 0.0), by_name.get("current_offset", 0.0)
    if not (gain or offset):
        return window
    current = (window.telemetry.current - offset) / (1.0 + gain)
    return replace(window, telemetry=replace(window.telemetry, current=current))


def _balance(window: Window, description: ActuatorDescription, unit: UnknownDriveUnit) -> Balance:
    """Return a balance in which friction varies over a turn as that of the healthy unit does.

    Where it grows, it grows by the same factor everywhere.
    """
    balance = Balance.of(window.telemetry, description, unit.knee)
    design, turn = balance.design.copy(), ripples(unit.parameters.P)["turn"].terms
    design[:, 1] += design[:, turn] @ unit.terms[turn] / unit.terms[1]
    return replace(balance, design=design)


def _prior(
    unit: UnknownDriveUnit,
    balances: Sequence[Balance],
    windows: Sequence[Window],
    inertia_sigma: float = _FREE,
) -> BalancePrior:
    """Return what a calibration says of motions; the inertia is over the torque per ampere."""
    mean, sigma = unit.terms.copy(), np.empty(len(unit.terms))
    friction = unit.terms[1]
    measured = {one.name: one for one in windows[0].measured}
    sigma[0] = inertia_sigma * unit.terms[0]
    sigma[1] = 3.0 * friction
    sigma[2] = max(abs(unit.terms[2]), 0.15 * friction / unit.fastest)
    if "viscous_friction" in measured:
        sigma[2] = max(measured["viscous_friction"].sigma * abs(unit.terms[2]), 1e-9)
        mean[2] *= 1.0 + measured["viscous_friction"].value
    changed = 0.3 * abs(unit.terms[3]) + 0.01 * friction
    sigma[3] = math.hypot(changed, math.sqrt(unit.covariance[3, 3]))
    sigma[4] = _LATER_S
    groups = ripples(unit.parameters.P)
    mean[groups["turn"].terms] = 0.0  # part of the friction: `_balance`
    for one in groups.values():
        sigma[one.terms] = _FREE if one.scales_with == OF_CURRENT else _FREE * friction
    healthy = unit.load, unit.stiffness
    return BalancePrior(mean, sigma, *loads_before(windows, balances, unit.parameters, healthy))


class _Conclusion:
    """What motions tell, as faults, causes and words.

    The torque per ampere is free where the motions show it (``is_learned``).
    """

    def __init__(
        self, windows: Sequence[Window], balances: Sequence[Balance], unit: UnknownDriveUnit
    ) -> None:
        self._unit, self._windows, self._balances = unit, windows, balances
        self._measured = {one.name: one for one in windows[0].measured}
        self._ripples = ripples(unit.parameters.P)
        groups = list(self._ripples.values())
        self._prior = _prior(unit, balances, windows)
        self.found = fit_with_ripples(balances, self._prior, unit.noise, groups)
        known = math.sqrt(unit.covariance[0, 0]) <= LEARNED * unit.terms[0]
        self._is_learned = known and self.found.sigma[0] <= LEARNED * self.found.values[0]
        if not self._is_learned:
            self._prior = _prior(unit, balances, windows, USUAL_TORQUE_CHANGE)
            self.found = fit_with_ripples(balances, self._prior, unit.noise, groups)
        self.faults = healthy_faults()
        self.unobservable = np.ones(N_FAULTS, dtype=bool)
        self.insignificant = np.zeros(N_FAULTS, dtype=bool)
        self.covariance = np.full((N_FAULTS, N_FAULTS), math.nan)
        self.causes: list[CauseEstimate] = []
        self.alternatives: list[tuple[str, str]] = []
        self.reasons: list[str] = []
        self.degraded: list[str] = []
        self._load_hides = False

    def conclude(self, widening: float) -> None:
        """Enter faults, causes and reasons, with standard deviations so much wider."""
        self._widening = widening
        self._compare_drag()
        self._set(FRICTION, *self._friction())
        if self.unobservable[FRICTION] and not self._load_hides:
            self.reasons.append(
                "the motion cannot separate friction from a load: it goes one way, or is too short"
            )
        self._load()
        self._viscous()
        self._backlash()
        for name, ripple in self._ripples.items():
            shown = bool(np.any(self.found.covariance[ripple.terms, ripple.terms]))
            if name == "eccentricity":
                self._eccentricity(ripple, shown)
            elif shown:
                self._repeats(name, ripple)
        seen = np.flatnonzero(~self.unobservable)
        variances = np.diag(self.covariance)[seen]
        self.covariance[np.ix_(seen, seen)] = np.diag(variances)

    def _compare_drag(self) -> None:
        """Say what has become of friction and the current that makes no torque, together.

        At one speed their sum alone is well known; in one direction not even that.
        """
        unit, found = self._unit, self.found
        both = [1, 3]
        healthy, now = (float(np.sum(terms[both])) for terms in (unit.terms, found.values))
        rise = now / healthy - 1.0
        floor, share = _FRICTION_MISMATCH if unit.speed_measured else _FRICTION_WITHOUT_SPEED
        variance = float(np.sum((found.covariance + unit.covariance)[np.ix_(both, both)]))
        sigma = self._widening * math.hypot(
            math.sqrt(variance) / healthy, 2.0 * floor, share * rise
        )
        if sigma > UNOBSERVABLE_SIGMA:
            return
        self.reasons.append(
            f"current that follows the direction {now:.3g} ± {sigma * healthy:.2g} A, "
            f"{100.0 * rise:+.1f} ± {100.0 * sigma:.1f} % of healthy"
        )

    def _set(self, number: int, value: float, sigma: float) -> None:
        """Enter a component, healthy where it is not significant."""
        sigma *= self._widening
        if not sigma <= UNOBSERVABLE_SIGMA:
            return
        self.unobservable[number] = False
        self.covariance[number, number] = sigma**2
        if value - healthy_faults()[number] < SIGNIFICANT_SIGMAS[number] * sigma:
            self.insignificant[number] = True
        else:
            self.faults[number] = min(value, 1.0)

    def _friction(self) -> tuple[float, float]:
        """Say what became of the torque per ampere; return friction and its sigma with that."""
        unit, found, is_learned = self._unit, self.found, self._is_learned
        J, f = found.values[:2]
        J_0, f_0 = unit.terms[:2]
        # More inertia than when calibrated is no loss of torque.
        inertia, constant = (self._measured.get(name) for name in ("inertia", "torque_constant"))
        heavier = 1.0 + inertia.value if inertia else 1.0
        stronger = 1.0 + constant.value if constant else 1.0
        loss = 1.0 - J_0 / J * heavier / stronger
        relative = found.covariance[0, 0] / J**2 + unit.covariance[0, 0] / J_0**2
        variance = (1.0 - loss) ** 2 * relative
        variance += (_LOSS_MISMATCH if unit.speed_measured else _LOSS_WITHOUT_SPEED) ** 2
        for one in (inertia, constant):
            variance += one.sigma**2 if one else 0.0
        # What makes no torque is the same in both: where this motion knows it better, so is the
        # healthy friction. Friction is a torque where the torque per ampere is known, else a
        # current.
        f_0 += unit.friction_pull * (found.values[3] - unit.terms[3])
        level = f / f_0 * (J_0 / J * heavier if is_learned else 1.0)
        slope = np.zeros(len(found.values))
        slope[[0, 1, 3]] = -1.0 / J if is_learned else 0.0, 1.0 / f, -unit.friction_pull / f_0
        relative = slope @ found.covariance @ slope + (unit.friction_sigma / f_0) ** 2
        relative += unit.covariance[0, 0] / J_0**2 if is_learned else USUAL_TORQUE_CHANGE**2
        floor, share = _FRICTION_MISMATCH if unit.speed_measured else _FRICTION_WITHOUT_SPEED
        friction = (level - 1.0) / 2.0
        mismatch = math.hypot(floor, share * (level - 1.0) / 2.0)
        friction_sigma = math.hypot(level * math.sqrt(relative) / 2.0, mismatch)
        if not is_learned:
            beyond = self._load_beyond()
            rubs = _OF_LOAD * beyond / f_0 / 2.0
            self._load_hides = rubs > friction_sigma
            if self._load_hides:
                self.reasons.append(
                    f"the load is {beyond:.2g} A outside the loads of the healthy windows, and "
                    "friction may have changed with it"
                )
            friction_sigma = math.hypot(friction_sigma, rubs)
            self.reasons.append(
                "torque per ampere is not shown, as there is too little acceleration: friction is "
                f"in amperes, for a torque per ampere known to {100.0 * USUAL_TORQUE_CHANGE:.0f} %"
            )
            if friction > SIGNIFICANT_SIGMAS[FRICTION] * friction_sigma:
                self.alternatives.append(("friction", "torque constant"))
                self.degraded.append("not separated: friction or a loss of torque per ampere")
            return friction, friction_sigma
        sigma = math.sqrt(variance) * self._widening
        change = J / J_0 - 1.0
        if loss > _CERTAIN * sigma and friction < -_CERTAIN * friction_sigma:
            # Torque was lost and friction as well: that is more inertia instead.
            self._instead("inertia", "current sensor gain", change, sigma / max(1.0 - loss, 0.1))
            return (f / unit.terms[1] - 1.0) / 2.0, friction_sigma
        if loss < -_SIGNIFICANT * sigma:
            # Magnets do not gain; a sensor that reads low, or a lighter load, has the same effect.
            self._instead("current_gain", "inertia", change, sigma)
            return friction, friction_sigma
        self.causes.append(CauseEstimate("torque_constant", -loss, sigma))
        if loss > _SIGNIFICANT * sigma:
            self.alternatives += [
                ("torque constant", "current sensor gain"),
                ("torque constant", "inertia"),
            ]
            if not self._measured.keys() & {"torque_constant", "inertia", "current_gain"}:
                self.degraded.append(
                    f"torque per ampere {-100.0 * loss:+.1f} ± {100.0 * sigma:.1f} %: magnets "
                    "(their temperature too), windings, a current sensor that reads high and more "
                    "inertia have the same effect"
                )
        return friction, friction_sigma

    def _load_beyond(self) -> float:
        """Return by how much the load is outside that of the healthy windows [A]."""
        least, largest = self._unit.normal.loads
        loads = self.found.loads[:, 0] - self._unit.load
        return float(np.max(np.maximum(least - loads, loads - largest), initial=0.0))

    def _instead(self, name: str, other: str, value: float, sigma: float) -> None:
        """Name a cause that explains an impossible change of the torque per ampere."""
        cause = CauseEstimate(name, value, sigma)
        self.causes.append(cause)
        label = {"inertia": "inertia", "current_gain": "current sensor gain"}[name]
        self.alternatives += [(label, "torque constant"), (label, other)]
        self.degraded.append(
            f"taken for {cause}, which cannot be separated from torque per ampere and {other}"
        )

    def _load(self) -> None:
        found, k_t = self.found, self._unit.parameters.k_t
        loads = found.loads[:, 0] - self._unit.load
        sigmas = np.sqrt(found.load_covariances[:, 0, 0])
        at = int(np.argmax(np.abs(loads) / np.maximum(sigmas, 1e-12)))
        if abs(loads[at]) > _SIGNIFICANT * sigmas[at] and abs(loads[at]) > self._unit.noise:
            one = CauseEstimate("load_torque", float(k_t * loads[at]), float(k_t * sigmas[at]))
            self.causes.append(one)
            self.alternatives.append(("load torque", "current sensor offset"))

    def _viscous(self) -> None:
        healthy = self._unit.terms[2]
        change = self.found.values[2] - self._prior.mean[2]
        sigma = float(self.found.sigma[2])
        matters = abs(change) * self._unit.fastest > 0.1 * self._unit.terms[1]
        if abs(change) > 2.0 * _SIGNIFICANT * sigma and matters and healthy > 0.0:
            relative = CauseEstimate("viscous_friction", float(change / healthy), sigma / healthy)
            self.causes.append(relative)

    def _backlash(self) -> None:
        unit, found = self._unit, self.found
        plays = [one.play for one in self._balances if one.play is not None]
        if not plays or math.isnan(unit.play):
            self.reasons.append(
                "backlash is not shown: the calibration does not have it"
                if math.isnan(unit.play)
                else "backlash is not shown: the shaft does not reverse twice"
            )
            return
        weights = np.array([max(one.sigma, 1e-9) ** -2.0 for one in plays])
        width = float(weights @ [one.width for one in plays] / weights.sum())
        sigma = math.hypot(float(weights.sum() ** -0.5), unit.play_sigma)
        span = 99.0 * unit.parameters.BLK
        value = (width - unit.play) / span
        floor, share = _BACKLASH_MISMATCH
        if not unit.speed_measured:
            is_slow = unit.sample_period > _SLOW_S
            floor, share = _BACKLASH_OF_SLOW_RECORDS if is_slow else _BACKLASH_WITHOUT_SPEED
        sigma = math.hypot(sigma / span, math.hypot(floor, share * value))
        if not unit.speed_measured:
            # All of the healthy figure may be lag, which grows with the speed.
            faster = max(_beyond(one, unit)[0] for one in self._windows)
            sigma = math.hypot(sigma, (faster - 1.0) * unit.play / span)
        load = float(np.max(np.abs(found.loads[:, 0])))
        # With a measured speed a play as wide as the healthy one is seen to be there; without it,
        # the lag of the drive is part of the figure, and one without play looks alike.
        seen = unit.play + value * span if unit.speed_measured else value * span
        is_hidden = seen < _SIGNIFICANT * (sigma * self._widening) * span
        if load > _LOAD_HIDES * found.values[1] and is_hidden:
            self.reasons.append(
                f"backlash is hidden: a load of {load:.2g} A, beside {found.values[1]:.2g} A of "
                "friction, can keep the gear on one flank"
            )
        else:
            self._set(BACKLASH, value, sigma)

    def _eccentricity(self, ripple: Ripple, shown: bool) -> None:
        found: Fit = self.found
        if not shown:
            fitted = np.diag(found.covariance) > 0.0
            fitted[ripple.terms] = True
            found = fit(self._balances, self._prior, fitted, self._unit.noise)
        change = found.values[ripple.terms] - self._prior.mean[ripple.terms]
        zeta = 2.0 / _WAVES * float(np.hypot.reduce(change))
        largest = np.max(np.linalg.eigvalsh(found.covariance[ripple.terms, ripple.terms]))
        spread = 2.0 / _WAVES * float(np.sqrt(largest))
        floor, relative = _ECCENTRICITY_MISMATCH
        sigma = math.sqrt(spread**2 + floor**2 + (relative * zeta) ** 2)
        self._set(ECCENTRICITY, zeta if shown else 0.0, sigma)
        if self.unobservable[ECCENTRICITY]:
            self.reasons.append("eccentricity is not shown: the motor turns too little")

    def _repeats(self, name: str, ripple: Ripple) -> None:
        """Say which torque repeats with the angle."""
        found = self.found
        change = found.values[ripple.terms] - self._prior.mean[ripple.terms]
        size = float(np.hypot.reduce(change))
        sigma = float(np.sqrt(np.max(np.diag(found.covariance)[ripple.terms])))
        orders = " and ".join(str(order) for order in ripple.orders)
        distance = math.sqrt(evidence(found, self._prior, ripple))
        if ripple.scales_with == OF_CURRENT:
            amount = f"{100.0 * size:.1f} ± {100.0 * sigma:.1f} % of the torque per ampere"
        else:
            amount = f"{size:.3g} ± {sigma:.2g} A"
        self.reasons.append(
            f"torque repeats {orders} times a turn of the motor ({ripple.label}): {amount}, "
            f"{distance:.0f} sigma"
        )
        if name == "cogging":
            k_t = self._unit.parameters.k_t
            self.causes.append(CauseEstimate("cogging", k_t * size, k_t * sigma))
        elif name == "turn":
            f = float(found.values[1])
            self.causes.append(CauseEstimate("friction_ripple", size / f, sigma / f))
