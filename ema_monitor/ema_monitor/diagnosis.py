# SPDX-License-Identifier: Apache-2.0
"""Diagnosis of one actuator: fault estimates from windows and stretches of motion."""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.description import ActuatorDescription
from ema_core.display import Displayed
from ema_core.expecting import require_type, value_or_default
from ema_core.faults import fault_vector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import CALIBRATIONS, AnyCalibration
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import Estimate, Verdict, refusal
from ema_monitor.identification.joint_estimate import identify_record
from ema_monitor.identification.memory import NOTHING, Memory
from ema_monitor.identification.search import Generation, ModelIdentification
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Combining, Tally
from ema_monitor.joint.departure import Departure
from ema_monitor.joint.window_figures import WindowFigures, figures_of
from ema_monitor.model.measured import measured_causes
from ema_monitor.reasons import CalibrationMissing, Reason, StretchesInsufficient
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_CALIBRATIONS: Final = (*CALIBRATIONS, *get_args(CalibrationMissing))
_FAULT_EXPLAINS: Final = 3.0
_CAUSE_EXPLAINS: Final = 2.0
"""Number of standard deviations beyond which a fault or cause explains a departure."""


def _identified(
    window: Window | Refusal,
    description: ActuatorDescription,
    calibration: AnyCalibration | CalibrationMissing,
    settings: SearchSettings,
    force: bool,
    previous: ArrayLike | None,
    memory: Memory = NOTHING,
) -> Generator[Generation, None, Estimate]:
    """Yield the generations of an identification, for any drive, and return its estimate."""
    if isinstance(calibration, JointCalibration):
        return identify_record(window, description, calibration, force=force)
    faults = None if previous is None else fault_vector(previous)
    result = yield from ModelIdentification(
        window, description, calibration, settings, force, faults, memory=memory
    ).run()
    return _judged(result.estimate, _figures(window, calibration), calibration, description)


def _figures(
    window: Window | Refusal, calibration: AnyCalibration | CalibrationMissing
) -> list[WindowFigures]:
    """Return the figures of a window, if the calibration has a baseline for the comparison.

    If a cause was measured, the list is empty: the load may differ from the baseline.
    """
    if isinstance(window, Refusal) or not isinstance(calibration, Calibration) or window.measured:
        return []
    return figures_of(window.telemetry) if calibration.baseline.windows else []


def _judged(
    estimate: Estimate,
    parts: Sequence[WindowFigures],
    calibration: AnyCalibration | CalibrationMissing,
    description: ActuatorDescription,
) -> Estimate:
    """Return the estimate, with the verdict "departed" if nothing explains a departure.

    Refused windows are judged as well, unless they belong to another unit.
    """
    unjudged = (Verdict.FAILED, Verdict.SKIPPED)
    if not isinstance(calibration, Calibration) or estimate.verdict in unjudged:
        return estimate
    estimate = replace(estimate, parts=tuple(parts))
    departure = calibration.baseline.departure(estimate.start_ns, parts)
    is_foreign = not estimate.valid and calibration.unit_mismatch(description)
    if departure is None or is_foreign:
        return estimate
    reasons: list[Reason | None] = [departure.likeness]
    if not departure.is_significant:
        reasons.insert(0, departure.would_depart)
    elif not (estimate.valid and _is_explained(estimate, departure)):
        reasons.insert(0, departure.reason)
        estimate = replace(estimate, verdict=Verdict.DEPARTED)
    return replace(estimate, reasons=(*filter(None, reasons), *estimate.reasons))


def _is_explained(estimate: Estimate, departure: Departure) -> bool:
    """Return whether an estimated fault or cause explains a departure.

    No cause explains a labelled state. A load explains only figures that it can change.
    """
    away = np.abs(np.subtract(estimate.faults, healthy_faults()))
    far = away > _FAULT_EXPLAINS * np.asarray(estimate.sigma)
    causes = () if departure.is_named else estimate.causes
    return bool(np.any(estimate.found & far)) or any(
        abs(cause.value) > _CAUSE_EXPLAINS * cause.sigma
        and (departure.load_explains or cause.name != "load_torque")
        for cause in causes
    )


class Identification:
    """One identification: iterate over its generations, then read ``estimate``.

    Parameters
    ----------
    window
        The window, or the refusal of a window.
    description
        The actuator.
    calibration
        Its calibration, or the reason why it has none.
    settings
        Settings of the search; unused for an unknown drive, whose record is compared with the
        measured current of healthy records instead.
    force
        Identify even if the calibration does not match the unit.
    previous
        Faults at which the search starts, (8,) [-]; None for a cold start.

    Attributes
    ----------
    estimate
        The estimate; None before the iteration has ended.
    """

    def __init__(
        self,
        window: Window | Refusal,
        description: ActuatorDescription,
        calibration: AnyCalibration | CalibrationMissing,
        settings: SearchSettings,
        *,
        force: bool = False,
        previous: ArrayLike | None = None,
    ) -> None:
        self._run = _identified(window, description, calibration, settings, force, previous)
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the state after each generation, then set ``estimate``.

        For a refused window, and for an unknown drive, nothing is yielded.
        """
        self.estimate = yield from self._run


def identify(
    window: Window | Refusal,
    description: ActuatorDescription | None = None,
    calibration: AnyCalibration | CalibrationMissing | None = None,
    settings: SearchSettings | None = None,
    *,
    force: bool = False,
    previous: ArrayLike | None = None,
    measured: Mapping[str, tuple[float, float]] | None = None,
) -> Estimate:
    """Identify the faults in a window and return the estimate, without progress reports.

    Parameters
    ----------
    window, settings, force, previous
        See ``Identification``.
    description, calibration
        The actuator and its calibration, or the reason why it has none. None for the built-in
        actuator and its shipped calibration.
    measured
        Measured hidden causes: value and standard deviation by name (see ``measured_causes``);
        None for the measured causes of the window.

    Raises
    ------
    ValueError
        If an argument has a wrong type, or a measured cause is unknown or impossible.
    """
    hint = "find_windows(telemetry) returns windows"
    require_type("window", window, (Window, Refusal), hint)
    if measured is not None:
        causes = measured_causes(measured)
        window = window if isinstance(window, Refusal) else replace(window, measured=causes)
    identification = Identification(
        window,
        value_or_default("description", description, ActuatorDescription, ActuatorDescription),
        value_or_default("calibration", calibration, _CALIBRATIONS, Calibration.builtin),
        value_or_default("settings", settings, SearchSettings, SearchSettings),
        force=force,
        previous=previous,
    )
    for _ in identification:
        pass
    if identification.estimate is None:
        raise RuntimeError("the identification ended without an estimate")
    return identification.estimate


class NumberedWindow(Protocol):
    """Numbered window or refusal of an actuator, from a window finder or a recording."""

    @property
    def number(self) -> int:
        """Running number of the window."""
        ...

    @property
    def description(self) -> ActuatorDescription:
        """The actuator, as described at the time of the window."""
        ...

    @property
    def window(self) -> Window | Refusal:
        """The window or its refusal."""
        ...


@dataclass(frozen=True, repr=False)
class Diagnosed(Displayed):
    """An estimate with its actuator and the numbers of its windows."""

    number: int
    """Number of the window; for combined stretches, running number of the estimate."""

    last: int
    """Number of the latest window used."""

    description: ActuatorDescription
    """The actuator."""

    estimate: Estimate
    """The estimate, or a refusal with its reason."""

    @property
    def brief(self) -> str:
        """Number, verdict and significant faults, or the reason of a refusal."""
        what = "estimate" if self.estimate.stretches else "window"
        return f"{what} {self.number}, {self.estimate.brief}"


@dataclass
class _Motion:
    """Ordinary motion of one unit."""

    combination: Combining
    key: tuple[object, ...]
    description: ActuatorDescription
    calibration: AnyCalibration | CalibrationMissing
    search: SearchSettings

    since: dict[int, tuple[int, int, list[WindowFigures]]] = field(default_factory=dict)
    """Start and end stamps [ns] and figures of the stretches since the last estimate, keyed by
    number.

    A stretch whose search was cancelled may be added again under its number.
    """

    fruitless: int = 0
    """Number of combinations that ended without an estimate and have been handled."""

    def judged(self, estimate: Estimate) -> Estimate:
        """Return the estimate with a verdict from all motion since the previous estimate.

        Refused stretches count as well: the departure may be something the model cannot explain.
        """
        parts = [part for *_, figures in self.since.values() for part in figures]
        return _judged(estimate, parts, self.calibration, self.description)


class Diagnosis:
    """Diagnoses one actuator, window by window.

    If description and calibration are unchanged, a search starts at the faults of the latest valid
    estimate, with earlier tests as its prior, unless ``SearchSettings.memory`` or ``warm_start`` is
    False. Stretches of ordinary motion are combined; a change of description, calibration or
    settings starts a new combination. The estimates depend only on the windows and their order:
    live, in a replay and offline, the same windows give the same estimates.
    """

    def __init__(self) -> None:
        # Description, calibration and faults of the latest valid estimate.
        self._last: tuple[tuple[object, ...], NDArray[np.float64] | None] = (), None
        self._memory = NOTHING
        self._motion: _Motion | None = None
        self._combined = 0
        self._latest = 0

    def add(
        self,
        segment: NumberedWindow,
        calibration: AnyCalibration | CalibrationMissing,
        search: SearchSettings,
        combining: CombinationSettings | None = None,
        *,
        force: bool = False,
    ) -> Iterator[Generation | Diagnosed]:
        """Yield the state after each generation of the search, and each estimate.

        To cancel a search, stop iterating: the state of the diagnosis is then unchanged.

        Parameters
        ----------
        segment
            The next window or refusal.
        calibration
            Calibration of the actuator, or the reason why it has none.
        search
            Settings of the identification.
        combining
            Settings of the combination of stretches of ordinary motion; None for a test window.
            Records of a controller without a model are never combined.
        force
            Identify even if the calibration does not match the unit.

        Raises
        ------
        ValueError
            If the settings cannot be used.
        """
        self._latest, window = segment.number, segment.window
        described = segment.description, _identity(calibration)
        previous, memory = None, NOTHING
        if search.warm_start and search.memory and self._last[0] == described:
            previous, memory = self._last[1], self._memory.before(window.start_ns)
        if combining is not None and not isinstance(calibration, JointCalibration):
            yield from self._combine(
                window, segment.description, calibration, search, combining, previous, force
            )
        else:
            estimate = yield from _identified(
                window, segment.description, calibration, search, force, previous, memory
            )
            yield Diagnosed(segment.number, segment.number, segment.description, estimate)
            self.begin_at(segment.description, estimate)

    def finish(self) -> list[Diagnosed]:
        """End the motion. Return the estimate of the stretches combined so far, if any."""
        motion = self._motion
        if motion is None:
            return []
        results = [self._numbered(motion, estimate) for estimate in motion.combination.finish()]
        return results + self._departed_without_estimate(motion)

    @property
    def tally(self) -> Tally:
        """Number of stretches by result since the combination started; zeros without one."""
        return Tally() if self._motion is None else self._motion.combination.tally

    def begin_at(self, description: ActuatorDescription, estimate: Estimate) -> None:
        """Start the next search at an estimate, if it is valid and every fault is finite.

        Successive estimates of a history form the memory of the unit; an estimate from a cold
        start begins a new memory.
        """
        if estimate.valid and np.all(np.isfinite(estimate.faults)):
            described = description, estimate.calibration_id
            is_next = self._last[0] == described and estimate.warm_start
            memory = self._memory if is_next else NOTHING
            self._memory = memory.updated(estimate)
            self._last = described, np.array(estimate.faults)

    def stopped(self) -> "Diagnosis":
        """Return a copy that starts at the same faults, without combined stretches."""
        twin = Diagnosis()
        twin._last, twin._memory = self._last, self._memory
        return twin

    def _combine(
        self,
        window: Window | Refusal,
        description: ActuatorDescription,
        calibration: Calibration | CalibrationMissing,
        search: SearchSettings,
        combining: CombinationSettings,
        previous: NDArray[np.float64] | None,
        force: bool,
    ) -> Iterator[Generation | Diagnosed]:
        key = (description, _identity(calibration), search, combining)
        if self._motion is None or self._motion.key != key:
            new = Combination(
                description, calibration, search, combining, previous=previous, force=force
            )
            yield from self.finish()
            self._motion = _Motion(new, key, description, calibration, search)
        motion = self._motion
        figures = _figures(window, calibration)
        motion.since[self._latest] = window.start_ns, window.end_ns, figures
        for number in list(motion.since)[: -combining.most_stretches]:
            del motion.since[number]
        for step in motion.combination.add(window):
            yield self._numbered(motion, step) if isinstance(step, Estimate) else step
        yield from self._departed_without_estimate(motion)

    def _numbered(self, motion: _Motion, estimate: Estimate) -> Diagnosed:
        estimate = motion.judged(estimate)
        motion.since.clear()
        self.begin_at(motion.description, estimate)
        self._combined += 1
        return Diagnosed(self._combined - 1, self._latest, motion.description, estimate)

    def _departed_without_estimate(self, motion: _Motion) -> list[Diagnosed]:
        """Return a refusal if a combination gave no estimate and its stretches depart.

        Otherwise the list is empty.
        """
        is_new = motion.combination.tally.fruitless > motion.fruitless
        motion.fruitless = motion.combination.tally.fruitless
        if not is_new or not (stretches := list(motion.since.values())):
            return []
        whole = Refusal(stretches[0][0], stretches[-1][1], StretchesInsufficient())
        nothing = refusal(whole, motion.calibration, motion.search, whole.cause)
        nothing = replace(nothing, stretches=len(stretches))
        if motion.judged(nothing).verdict == Verdict.DEPARTED:
            return [self._numbered(motion, nothing)]
        motion.since.clear()
        return []


def _identity(calibration: AnyCalibration | CalibrationMissing) -> str | CalibrationMissing:
    return calibration if isinstance(calibration, Reason) else calibration.calibration_id


def diagnose(
    windows: Iterable[NumberedWindow],
    calibration: AnyCalibration | CalibrationMissing,
    search: SearchSettings | None = None,
    combining: CombinationSettings | None = None,
    *,
    force: bool = False,
) -> Iterator[Generation | Diagnosed]:
    """Yield the generations and estimates of one actuator's windows, with the same settings.

    The arguments are described in `Diagnosis.add`. If ``search`` is None, the default settings are
    used.
    """
    diagnosis = Diagnosis()
    for segment in windows:
        yield from diagnosis.add(
            segment, calibration, search or SearchSettings(), combining, force=force
        )
    yield from diagnosis.finish()
