"""Diagnosis of one actuator: windows and stretches of motion in, estimates of its faults out."""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.description import ActuatorDescription
from ema_core.expecting import require_type
from ema_core.faults import fault_vector, healthy_faults
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibration.joint_calibration import JointCalibration
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.identification.combination import Combination
from ema_monitor.identification.estimate import DEPARTED, FAILED, SKIPPED, Estimate, refusal
from ema_monitor.identification.joint_estimate import identify_record
from ema_monitor.identification.memory import NOTHING, Memory
from ema_monitor.identification.search import Generation, ModelIdentification
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings, Combining, Tally
from ema_monitor.joint.departure import Departure
from ema_monitor.joint.window_figures import WindowFigures, figures_of
from ema_monitor.model.measured import measured_causes
from ema_monitor.reasons import LabelledState, Reason, StretchesInsufficient
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window

_FAULT_EXPLAINS: Final = 3.0
_CAUSE_EXPLAINS: Final = 2.0
"""Standard deviations beyond which a fault, or a cause, explains what departs."""


def _identified(
    window: Window | Refusal,
    description: ActuatorDescription,
    calibration: AnyCalibration | str,
    settings: SearchSettings,
    force: bool,
    previous: ArrayLike | None,
    memory: Memory = NOTHING,
) -> Generator[Generation, None, Estimate]:
    """Yield the state after each generation, and return the estimate of any drive."""
    if isinstance(calibration, JointCalibration):
        return identify_record(window, description, calibration, force=force)
    faults = None if previous is None else fault_vector(previous)
    result = yield from ModelIdentification(
        window, description, calibration, settings, force, faults, memory=memory
    ).run()
    return _judged(result.estimate, _figures(window, calibration), calibration, description)


def _figures(window: Window | Refusal, calibration: AnyCalibration | str) -> list[WindowFigures]:
    """Return the figures of a window, if there is a baseline to compare them with.

    There are none if a cause was measured: the load may be another one.
    """
    if isinstance(window, Refusal) or not isinstance(calibration, Calibration) or window.measured:
        return []
    return figures_of(window.telemetry) if calibration.baseline.windows else []


def _judged(
    estimate: Estimate,
    parts: Sequence[WindowFigures],
    calibration: AnyCalibration | str,
    description: ActuatorDescription,
) -> Estimate:
    """Return an estimate as departed where the motion does and nothing that was found explains it.

    A window that is refused is judged, too, unless it is of another unit.
    """
    if not isinstance(calibration, Calibration) or estimate.verdict in (FAILED, SKIPPED):
        return estimate
    estimate = replace(estimate, parts=tuple(parts))
    departure = calibration.baseline.departure(estimate.start_ns, parts)
    is_foreign = not estimate.valid and calibration.unit_mismatch(description)
    if departure is None or is_foreign:
        return estimate
    state = LabelledState(departure.likeness) if departure.likeness else None
    found: list[Reason | None] = [state]
    if not departure.is_significant:
        found.insert(0, departure.would_depart)
    elif not (estimate.valid and _is_explained(estimate, departure)):
        found = [departure.reason]
        estimate = replace(estimate, verdict=DEPARTED)
    return replace(estimate, reasons=(*filter(None, found), *estimate.reasons))


def _is_explained(estimate: Estimate, departure: Departure) -> bool:
    """Return whether a fault or a cause was found that explains what departs.

    No cause explains a state with a name; a small load, or a known one, only what it can change.
    """
    away = np.abs(np.subtract(estimate.faults, healthy_faults()))
    far = away > _FAULT_EXPLAINS * np.asarray(estimate.sigma)
    causes = () if departure.is_named else estimate.causes
    return bool(np.any(estimate.found & far)) or any(
        abs(one.value) > _CAUSE_EXPLAINS * one.sigma
        and (departure.load_explains or one.name != "load_torque")
        for one in causes
    )


class Identification:
    """One identification: iterate over its generations, then read ``estimate``.

    Parameters
    ----------
    window, description, calibration, settings, force, previous
        As of ``ModelIdentification``. Where the drive is unknown there is no search, and the
        measured current takes its place.

    Attributes
    ----------
    estimate
        The estimate; None before the iteration has ended.
    """

    def __init__(
        self,
        window: Window | Refusal,
        description: ActuatorDescription,
        calibration: AnyCalibration | str,
        settings: SearchSettings,
        *,
        force: bool = False,
        previous: ArrayLike | None = None,
    ) -> None:
        self._run = _identified(window, description, calibration, settings, force, previous)
        self.estimate: Estimate | None = None

    def __iter__(self) -> Iterator[Generation]:
        """Yield the state after each generation; there is none where a window is refused."""
        self.estimate = yield from self._run


def identify(
    window: Window | Refusal,
    description: ActuatorDescription | None = None,
    calibration: AnyCalibration | str | None = None,
    settings: SearchSettings | None = None,
    *,
    force: bool = False,
    previous: ArrayLike | None = None,
    measured: Mapping[str, tuple[float, float]] | None = None,
) -> Estimate:
    """Identify the faults in a window, without progress.

    Parameters
    ----------
    window, description, calibration, settings, force, previous
        As of ``Identification``. Description and calibration are those of the built-in actuator
        when None.
    measured
        Hidden causes that were measured, value and standard deviation by name, as of
        ``measured_causes``; those of the window when None.

    Raises
    ------
    ValueError
        As of ``measured_causes``, or when it is given anything but a window.
    """
    hint = "find_windows(telemetry) gives the windows of telemetry"
    require_type("window", window, (Window, Refusal), hint)
    if measured is not None:
        known = measured_causes(measured)
        window = window if isinstance(window, Refusal) else replace(window, measured=known)
    identification = Identification(
        window,
        description or ActuatorDescription(),
        Calibration.builtin() if calibration is None else calibration,
        settings or SearchSettings(),
        force=force,
        previous=previous,
    )
    for _ in identification:
        pass
    if identification.estimate is None:
        raise RuntimeError("the identification ended without an estimate")
    return identification.estimate


class Found(Protocol):
    """A window, or the refusal of one, as a finder or a recording gives it."""

    @property
    def number(self) -> int:
        """Running number of the window."""
        ...

    @property
    def description(self) -> ActuatorDescription:
        """The actuator, as it was described at the time."""
        ...

    @property
    def window(self) -> Window | Refusal:
        """The window, or why there is none."""
        ...


class Diagnosed(NamedTuple):
    """An estimate and what it is of.

    Attributes
    ----------
    number
        Number of the window; of combined stretches, running number of the estimate.
    last
        Number of the latest window that was looked at.
    description
        The actuator.
    estimate
        The estimate, or a refusal with its reason.
    """

    number: int
    last: int
    description: ActuatorDescription
    estimate: Estimate


@dataclass
class _Motion:
    """Ordinary motion of one unit.

    ``since`` has stamps and figures of the stretches since the last estimate, by number: one may be
    looked at again. ``fruitless`` are the combinations known to have come to nothing.
    """

    combination: Combining
    key: tuple[object, ...]
    description: ActuatorDescription
    calibration: AnyCalibration | str
    search: SearchSettings
    since: dict[int, tuple[int, int, list[WindowFigures]]] = field(default_factory=dict)
    fruitless: int = 0

    def judged(self, estimate: Estimate) -> Estimate:
        """Return an estimate, judged by all motion since the last one.

        That counts which was refused, too: what departs may be what no model explains.
        """
        parts = [part for *_, some in self.since.values() for part in some]
        return _judged(estimate, parts, self.calibration, self.description)


class Diagnosis:
    """Diagnoses one actuator, window by window.

    A search begins at the faults of the last valid estimate, and earlier tests are its prior, if
    they were of the same description and calibration. Stretches of ordinary motion are combined;
    under another description, calibration or other settings a new combination begins. The estimates
    depend on the windows and their order alone: live, in a replay and offline, the same windows
    give the same estimates.
    """

    def __init__(self) -> None:
        # Description and calibration of the last valid estimate, and its faults.
        self._last: tuple[tuple[object, ...], NDArray[np.float64] | None] = (), None
        self._memory = NOTHING
        self._motion: _Motion | None = None
        self._combined = 0
        self._looked_at = 0

    def add(
        self,
        found: Found,
        calibration: AnyCalibration | str,
        search: SearchSettings,
        combining: CombinationSettings | None = None,
        *,
        force: bool = False,
    ) -> Iterator[Generation | Diagnosed]:
        """Yield the state after each generation of the search, and the estimates as they are made.

        A search is cancelled by not going on: what is known of the actuator is left as it was.

        Parameters
        ----------
        found
            The next window, or its refusal.
        calibration
            Calibration of the actuator, or why there is none.
        search
            How to identify.
        combining
            Until when stretches of ordinary motion are combined; None for a test window. Records of
            a controller that is not modelled are never combined.
        force
            As of `Identification`.

        Raises
        ------
        ValueError
            When the settings cannot be used.
        """
        self._looked_at, window = found.number, found.window
        described = found.description, _identity(calibration)
        previous, memory = None, NOTHING
        if search.warm_start and search.memory and self._last[0] == described:
            previous, memory = self._last[1], self._memory.before(window.start_ns)
        if combining is not None and not isinstance(calibration, JointCalibration):
            yield from self._combine(
                window, found.description, calibration, search, combining, previous, force
            )
        else:
            estimate = yield from _identified(
                window, found.description, calibration, search, force, previous, memory
            )
            yield Diagnosed(found.number, found.number, found.description, estimate)
            self.begin_at(found.description, estimate)

    def finish(self) -> list[Diagnosed]:
        """End the motion; return the estimate of the stretches combined so far, if there is one."""
        if self._motion is None:
            return []
        made = [self._numbered(self._motion, one) for one in self._motion.combination.finish()]
        return made + self._come_to_nothing(self._motion)

    @property
    def tally(self) -> Tally:
        """How many stretches there were since the combination was set up."""
        return Tally() if self._motion is None else self._motion.combination.tally

    def begin_at(self, description: ActuatorDescription, estimate: Estimate) -> None:
        """Let the next search begin at an estimate, if it is valid and knows every fault.

        The estimates of a history, one after the other, become the memory of the unit; one that
        began cold begins another.
        """
        if estimate.valid and np.all(np.isfinite(estimate.faults)):
            described = description, estimate.calibration_id
            is_next = self._last[0] == described and estimate.warm_start
            known = self._memory if is_next else NOTHING
            self._memory = known.updated(estimate)
            self._last = described, np.array(estimate.faults)

    def stopped(self) -> "Diagnosis":
        """Return a diagnosis that begins at the same faults, with no stretches combined."""
        twin = Diagnosis()
        twin._last, twin._memory = self._last, self._memory
        return twin

    def _combine(
        self,
        window: Window | Refusal,
        description: ActuatorDescription,
        calibration: Calibration | str,
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
        motion.since[self._looked_at] = window.start_ns, window.end_ns, figures
        for old in list(motion.since)[: -combining.most_stretches]:
            del motion.since[old]
        for one in motion.combination.add(window):
            yield self._numbered(motion, one) if isinstance(one, Estimate) else one
        yield from self._come_to_nothing(motion)

    def _numbered(self, motion: _Motion, estimate: Estimate) -> Diagnosed:
        estimate = motion.judged(estimate)
        motion.since.clear()
        self.begin_at(motion.description, estimate)
        self._combined += 1
        return Diagnosed(self._combined - 1, self._looked_at, motion.description, estimate)

    def _come_to_nothing(self, motion: _Motion) -> list[Diagnosed]:
        """Return as refused stretches that have shown no fault, if they depart."""
        is_new = motion.combination.tally.fruitless > motion.fruitless
        motion.fruitless = motion.combination.tally.fruitless
        if not is_new or not (stretches := list(motion.since.values())):
            return []
        whole = Refusal(stretches[0][0], stretches[-1][1], "")
        nothing = refusal(whole, motion.calibration, motion.search, StretchesInsufficient())
        nothing = replace(nothing, stretches=len(stretches))
        if motion.judged(nothing).verdict == DEPARTED:
            return [self._numbered(motion, nothing)]
        motion.since.clear()
        return []


def _identity(calibration: AnyCalibration | str) -> str:
    return calibration if isinstance(calibration, str) else calibration.calibration_id


def diagnose(
    windows: Iterable[Found],
    calibration: AnyCalibration | str,
    search: SearchSettings | None = None,
    combining: CombinationSettings | None = None,
    *,
    force: bool = False,
) -> Iterator[Generation | Diagnosed]:
    """Diagnose all windows of one actuator with the same settings, as `Diagnosis.add` does each."""
    diagnosis = Diagnosis()
    for found in windows:
        yield from diagnosis.add(
            found, calibration, search or SearchSettings(), combining, force=force
        )
    yield from diagnosis.finish()
