"""Faults of a unit whose drive is unknown, from one motion or several (M45, M46)."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription
from ema_core.faults import BACKLASH, ECCENTRICITY, FRICTION, N_FAULTS, FaultVector, healthy_faults
from ema_monitor.current_balance.balance import Balance
from ema_monitor.current_balance.calibrating import MotionDefect, motion_defect
from ema_monitor.current_balance.choosing import chosen_ripples, evidence
from ema_monitor.current_balance.fitting import BalancePrior, Fit, fit
from ema_monitor.current_balance.priors import basic_terms, of_unit, prior_of
from ema_monitor.current_balance.terms import Ripple, ripples
from ema_monitor.current_balance.unit import LEARNED, UnknownDriveUnit
from ema_monitor.health import USUAL_TORQUE_CHANGE
from ema_monitor.identification.estimate import CURRENT_DRIVEN, Estimate, refusal
from ema_monitor.identification.settings import MOST_UNEXPLAINED, SearchSettings
from ema_monitor.identification.uncertainty import SIGNIFICANT_SIGMAS, UNOBSERVABLE_SIGMA
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
_FEWEST_ROWS: Final = 12
# An eccentricity zeta makes ripples of zeta / 2: one wave where currents are sinusoidal, several of
# together 0.92 to 1 of that where they are commutated in six steps, of which two are fitted.
_WAVES: Final = 0.96


@dataclass(frozen=True, eq=False)
class CombinedMotions:
    """What several motions of a unit tell together, before it is said as faults.

    Attributes
    ----------
    loss, loss_sigma
        Loss of torque per ampere [-]; sigma is NaN where it is not learned.
    friction, friction_sigma
        Normalised dry friction [-].
    backlash, backlash_sigma
        Normalised backlash [-]; NaN where the motion does not show it.
    """

    found: Fit
    prior: BalancePrior
    balances: Sequence[Balance]
    loss: float
    loss_sigma: float
    friction: float
    friction_sigma: float
    backlash: float
    backlash_sigma: float


def identify_by_current(
    window: Window,
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
        The window, its actuator and calibration, and how to identify.
    force
        Make an estimate although the calibration is of another unit.
    """

    def refuse(reason: str, *, is_failure: bool = False) -> Estimate:
        return refusal(window, unit, settings, reason, is_failure=is_failure)

    mismatch = unit.unit_mismatch(description)
    reason = unit.shape_mismatch(window)
    defect = MotionDefect(reason) if reason else motion_defect(window, description)
    if defect is not None:
        return refuse(defect.reason, is_failure=defect.is_failure)
    if mismatch and not force:
        return refuse(f"the calibration does not fit: {mismatch}")
    caveats = [f"forced although {mismatch}"] if mismatch else []
    found = identify_unknown([window], description, unit, settings.goodness_limit, caveats)
    return refuse(found) if isinstance(found, str) else found


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
    balances = [
        of_unit(Balance.of(window.telemetry, description, unit.knee), unit) for window in windows
    ]
    rows = sum(int(np.count_nonzero(one.weight)) for one in balances)
    if rows < _FEWEST_ROWS:
        return (
            f"too little motion one way: {rows} means of it, at least {_FEWEST_ROWS} are needed; "
            "combine several stretches, or give longer ones"
        )
    motion = _fitted(windows, balances, unit)
    found = motion.found
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
    widening = max(1.0, goodness / goodness_limit)
    said = _Conclusion(motion, unit, windows, widening)
    degraded = said.degraded
    if goodness > goodness_limit:
        degraded = [f"goodness of fit {goodness:.1f}, limit {goodness_limit:.1f}", *degraded]
    if np.all(said.unobservable):
        return "; ".join(["no fault is observable", *said.reasons])
    reasons = [*degraded, *said.reasons, *caveats, NOT_SEEN]
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
        reason="; ".join(reasons),
        insignificant=said.insignificant,
        calibration_windows=unit.windows,
        verdict="degraded" if degraded else "valid",
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


def _fitted(
    windows: Sequence[Window], balances: Sequence[Balance], unit: UnknownDriveUnit
) -> CombinedMotions:
    """Fit the balances, with the torque per ampere free where the motion shows it."""
    prior = prior_of(unit, balances, windows)
    basic = basic_terms(len(unit.terms))
    groups = ripples(unit.parameters.P)
    found = chosen_ripples(balances, prior, basic, unit.noise, groups)
    known = math.sqrt(unit.covariance[0, 0]) <= LEARNED * unit.terms[0]
    is_learned = known and found.sigma[0] <= LEARNED * found.values[0]
    if not is_learned:
        prior = prior_of(unit, balances, windows, inertia_sigma=USUAL_TORQUE_CHANGE)
        found = chosen_ripples(balances, prior, basic, unit.noise, groups)
    J, f = found.values[:2]
    J_0, f_0 = unit.terms[:2]
    measured = {one.name: one for one in windows[0].measured}
    # More inertia than when calibrated is no loss of torque.
    inertia, constant = (measured.get(name) for name in ("inertia", "torque_constant"))
    heavier = 1.0 + inertia.value if inertia else 1.0
    stronger = 1.0 + constant.value if constant else 1.0
    loss = 1.0 - J_0 / J * heavier / stronger
    variance = (1.0 - loss) ** 2 * (found.covariance[0, 0] / J**2 + unit.covariance[0, 0] / J_0**2)
    variance += (_LOSS_MISMATCH if unit.speed_measured else _LOSS_WITHOUT_SPEED) ** 2
    for one in (inertia, constant):
        variance += one.sigma**2 if one else 0.0
    # What makes no torque is the same in both: where this motion knows it better, so is the
    # healthy friction. Friction is a torque where the torque per ampere is known, else a current.
    f_0 += unit.friction_pull * (found.values[3] - unit.terms[3])
    level = f / f_0 * (J_0 / J * heavier if is_learned else 1.0)
    slope = np.zeros(len(found.values))
    slope[[0, 1, 3]] = -1.0 / J if is_learned else 0.0, 1.0 / f, -unit.friction_pull / f_0
    relative = slope @ found.covariance @ slope + (unit.friction_sigma / f_0) ** 2
    if is_learned:
        relative += unit.covariance[0, 0] / J_0**2
    if not is_learned:
        relative += USUAL_TORQUE_CHANGE**2
    floor, share = _FRICTION_MISMATCH if unit.speed_measured else _FRICTION_WITHOUT_SPEED
    mismatch = math.hypot(floor, share * (level - 1.0) / 2.0)
    friction_sigma = math.hypot(level * math.sqrt(relative) / 2.0, mismatch)
    backlash, backlash_sigma = _backlash(balances, unit)
    return CombinedMotions(
        found,
        prior,
        balances,
        loss,
        math.sqrt(variance) if is_learned else math.nan,
        (level - 1.0) / 2.0,
        friction_sigma,
        backlash,
        backlash_sigma,
    )


def _backlash(balances: Sequence[Balance], unit: UnknownDriveUnit) -> tuple[float, float]:
    """Return the normalised backlash and its sigma, NaN where no motion shows it."""
    plays = [one.play for one in balances if one.play is not None]
    if not plays or math.isnan(unit.play):
        return math.nan, math.nan
    weights = np.array([max(one.sigma, 1e-9) ** -2.0 for one in plays])
    width = float(weights @ [one.width for one in plays] / weights.sum())
    sigma = math.hypot(float(weights.sum() ** -0.5), unit.play_sigma)
    span = 99.0 * unit.parameters.BLK
    value = (width - unit.play) / span
    floor, share = _BACKLASH_MISMATCH
    if not unit.speed_measured:
        is_slow = unit.sample_period > _SLOW_S
        floor, share = _BACKLASH_OF_SLOW_RECORDS if is_slow else _BACKLASH_WITHOUT_SPEED
    return value, math.hypot(sigma / span, math.hypot(floor, share * value))


class _Conclusion:
    """What a motion tells, as faults, causes and words."""

    def __init__(
        self,
        motion: CombinedMotions,
        unit: UnknownDriveUnit,
        windows: Sequence[Window],
        widening: float,
    ) -> None:
        self._motion, self._unit = motion, unit
        self._measured = {one.name for one in windows[0].measured}
        self.faults = healthy_faults()
        self.unobservable = np.ones(N_FAULTS, dtype=bool)
        self.insignificant = np.zeros(N_FAULTS, dtype=bool)
        self.covariance = np.full((N_FAULTS, N_FAULTS), math.nan)
        self.causes: list[CauseEstimate] = []
        self.alternatives: list[tuple[str, str]] = []
        self.reasons: list[str] = []
        self.degraded: list[str] = []
        self._widening = widening
        friction = self._torque_per_ampere()
        self._set(FRICTION, *friction)
        if self.unobservable[FRICTION]:
            self.reasons.append(
                "the motion does not tell friction from a load: it goes one way, or is too short"
            )
        self._load()
        self._viscous()
        self._play()
        self._ripples()
        for first in np.flatnonzero(~self.unobservable):
            for second in np.flatnonzero(~self.unobservable):
                if first != second:
                    self.covariance[first, second] = 0.0

    def _set(self, number: int, value: float, sigma: float) -> None:
        """Enter a component, healthy where it is not significant."""
        sigma *= self._widening
        if not sigma <= UNOBSERVABLE_SIGMA:
            return
        self.unobservable[number] = False
        self.covariance[number, number] = sigma**2
        healthy = healthy_faults()[number]
        if value - healthy < SIGNIFICANT_SIGMAS[number] * sigma:
            self.insignificant[number] = True
        else:
            self.faults[number] = min(value, 1.0)

    def _torque_per_ampere(self) -> tuple[float, float]:
        """Say what became of the torque per ampere; return friction and its sigma with that."""
        m = self._motion
        friction, friction_sigma = m.friction, m.friction_sigma
        if math.isnan(m.loss_sigma):
            self.reasons.append(
                "torque per ampere is not shown, as there is too little acceleration: friction is "
                f"in amperes, for a torque per ampere known to {100.0 * USUAL_TORQUE_CHANGE:.0f} %"
            )
            if friction > SIGNIFICANT_SIGMAS[FRICTION] * friction_sigma:
                self.alternatives.append(("friction", "torque constant"))
                self.degraded.append("not told apart: friction or a loss of torque per ampere")
            return friction, friction_sigma
        sigma = m.loss_sigma * self._widening
        change = m.found.values[0] / self._unit.terms[0] - 1.0
        in_amperes = (m.found.values[1] / self._unit.terms[1] - 1.0) / 2.0
        if m.loss > _CERTAIN * sigma and friction < -_CERTAIN * friction_sigma:
            # Torque was lost and friction as well: that is more inertia instead.
            self._instead("inertia", change, sigma / max(1.0 - m.loss, 0.1))
            return in_amperes, friction_sigma
        if m.loss < -_SIGNIFICANT * sigma:
            # Magnets do not gain; a sensor that reads low, or a lighter load, has the same effect.
            self._instead("current_gain", change, sigma)
            return friction, friction_sigma
        self.causes.append(CauseEstimate("torque_constant", -m.loss, sigma))
        if m.loss > _SIGNIFICANT * sigma:
            self.alternatives += [
                ("torque constant", "current sensor gain"),
                ("torque constant", "inertia"),
            ]
            if not self._measured & {"torque_constant", "inertia", "current_gain"}:
                self.degraded.append(
                    f"torque per ampere {-100.0 * m.loss:+.1f} ± {100.0 * sigma:.1f} %: magnets "
                    "(their temperature too), windings, a current sensor that reads high and more "
                    "inertia have the same effect"
                )
        return friction, friction_sigma

    def _instead(self, name: str, value: float, sigma: float) -> None:
        """Name a cause that explains an impossible change of the torque per ampere."""
        cause = CauseEstimate(name, value, sigma)
        self.causes.append(cause)
        label = {"inertia": "inertia", "current_gain": "current sensor gain"}[name]
        other = "inertia" if name == "current_gain" else "current sensor gain"
        self.alternatives += [(label, "torque constant"), (label, other)]
        self.degraded.append(
            f"taken for {cause}; torque per ampere and {other} are not told from it"
        )

    def _load(self) -> None:
        m, k_t = self._motion, self._unit.parameters.k_t
        loads = m.found.loads[:, 0] - self._unit.load
        sigmas = np.sqrt(m.found.load_covariances[:, 0, 0])
        at = int(np.argmax(np.abs(loads) / np.maximum(sigmas, 1e-12)))
        if abs(loads[at]) > _SIGNIFICANT * sigmas[at] and abs(loads[at]) > self._unit.noise:
            one = CauseEstimate("load_torque", float(k_t * loads[at]), float(k_t * sigmas[at]))
            self.causes.append(one)
            self.alternatives.append(("load torque", "current sensor offset"))

    def _viscous(self) -> None:
        m, healthy = self._motion, self._unit.terms[2]
        change = m.found.values[2] - m.prior.mean[2]
        sigma = float(m.found.sigma[2])
        matters = abs(change) * self._unit.fastest > 0.1 * self._unit.terms[1]
        if abs(change) > 2.0 * _SIGNIFICANT * sigma and matters and healthy > 0.0:
            self.causes.append(
                CauseEstimate("viscous_friction", float(change / healthy), sigma / healthy)
            )

    def _play(self) -> None:
        m, unit = self._motion, self._unit
        if math.isnan(m.backlash):
            self.reasons.append(
                "backlash is not shown: the calibration does not have it"
                if math.isnan(unit.play)
                else "backlash is not shown: the shaft does not reverse twice"
            )
            return
        load = float(np.max(np.abs(m.found.loads[:, 0])))
        sigma = m.backlash_sigma * self._widening
        # With a measured speed a play as wide as the healthy one is seen to be there; without it,
        # the lag of the drive is part of the figure, and one without play looks alike.
        span = 99.0 * unit.parameters.BLK
        seen = unit.play + m.backlash * span if unit.speed_measured else m.backlash * span
        if load > _LOAD_HIDES * m.found.values[1] and seen < _SIGNIFICANT * sigma * span:
            self.reasons.append(
                f"backlash is hidden: a load of {load:.2g} A, beside {m.found.values[1]:.2g} A of "
                "friction, can keep the gear on one flank"
            )
            return
        self._set(BACKLASH, m.backlash, m.backlash_sigma)

    def _ripples(self) -> None:
        m, unit = self._motion, self._unit
        groups = ripples(unit.parameters.P)
        for group in groups:
            where = unit.ripple(group.name)
            shown = bool(np.any(m.found.covariance[where, where]))
            if group.name == "eccentricity":
                self._eccentricity(group, where, shown)
            elif shown:
                self._named(group, where)

    def _eccentricity(self, group: Ripple, where: slice, shown: bool) -> None:
        m, unit = self._motion, self._unit
        found = m.found
        if not shown:
            fitted = np.diag(found.covariance) > 0.0
            fitted[where] = True
            found = fit(m.balances, m.prior, fitted, unit.noise)
        change = found.values[where] - m.prior.mean[where]
        zeta = 2.0 / _WAVES * float(np.hypot.reduce(change))
        spread = (
            2.0
            / _WAVES
            * float(np.sqrt(np.max(np.linalg.eigvalsh(found.covariance[where, where]))))
        )
        floor, relative = _ECCENTRICITY_MISMATCH
        sigma = math.sqrt(spread**2 + floor**2 + (relative * zeta) ** 2)
        self._set(ECCENTRICITY, zeta if shown else 0.0, sigma)
        if self.unobservable[ECCENTRICITY]:
            self.reasons.append("eccentricity is not shown: the motor turns too little")

    def _named(self, group: Ripple, where: slice) -> None:
        """Say which torque repeats with the angle."""
        m = self._motion
        change = m.found.values[where] - m.prior.mean[where]
        size = float(np.hypot.reduce(change))
        sigma = float(np.sqrt(np.max(np.diag(m.found.covariance)[where])))
        orders = " and ".join(str(order) for order in group.orders)
        distance = math.sqrt(evidence(m.found, m.prior, where))
        if group.scales_with == "current":
            amount = f"{100.0 * size:.1f} ± {100.0 * sigma:.1f} % of the torque per ampere"
        else:
            amount = f"{size:.3g} ± {sigma:.2g} A"
        self.reasons.append(
            f"torque repeats {orders} times a turn of the motor ({group.label}): {amount}, "
            f"{distance:.0f} sigma"
        )
        if group.name == "cogging":
            k_t = self._unit.parameters.k_t
            self.causes.append(CauseEstimate("cogging", k_t * size, k_t * sigma))
        elif group.name == "turn":
            f = float(m.found.values[1])
            self.causes.append(CauseEstimate("friction_ripple", size / f, sigma / f))
