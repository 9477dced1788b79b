# SPDX-License-Identifier: Apache-2.0
"""``ema verify``: recompute recorded estimates from the recorded telemetry."""

import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

import click
import numpy as np

from ema_archive.bag_task import DONE, diagnose_bag
from ema_archive.manifest import Manifest
from ema_archive.settings import estimation_software
from ema_archive.store import FILE as ARCHIVE_FILE
from ema_archive.tables import estimate_from
from ema_bags.reader import Bag
from ema_bags.telemetry import ESTIMATE_TYPE, described_actuators, read_telemetry
from ema_cli.bags.diagnoses import quantity_of
from ema_cli.bags.identifying import Identifying
from ema_cli.options import REFUSED
from ema_cli.progress import progress_bar
from ema_core.arrays import Array
from ema_core.causes import CauseEstimate
from ema_core.faults import N_FAULTS, FaultVector
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration, load_calibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.alternatives import Alternative
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.joint.comparison import Comparison
from ema_monitor.prognosis.history import read_intact_history
from ema_monitor.prognosis.order import moved
from ema_monitor.recordings.finding import find_recorded_windows
from ema_monitor.recordings.windows import RecordedWindow
from ema_ros.messages import faults_from_message
from ema_ros.stamps import stamp_from_message

SAME: Final = "identical"
ROUNDED: Final = "equal within rounding"
DIFFERENT: Final = "different"
CANNOT: Final = "cannot be recomputed"
ALTERED: Final = "altered"

_ROUNDING: Final = 1e-6


@dataclass(frozen=True)
class Verified:
    """Result of the verification of a recorded estimate."""

    actuator_id: str
    window: int | None
    """Window number; None for a whole history."""
    state: str = CANNOT
    difference: float = 0.0
    """Largest difference of a fault or quantity change [-]."""
    reason: str = ""
    bag: str = ""
    """Bag of the estimate in an archive; empty for other sources."""

    def __str__(self) -> str:
        place = f"{self.bag}: " if self.bag else ""
        window = "" if self.window is None else f", window {self.window}"
        words = f"{place}{self.actuator_id}{window}: {self.state}"
        if self.state in (ROUNDED, DIFFERENT) and self.difference:
            words += f", by {self.difference:.2g} at most"
        return f"{words} ({self.reason})" if self.reason else words

    def compared(self, recorded: Any, again: Estimate, by: str = "") -> Self:
        """Return the result of comparing a recorded estimate with its recomputation ``again``.

        ``by`` is the reason to state for a difference.
        """
        if (again.verdict, again.valid) != (recorded.verdict, recorded.valid):
            words = f"the verdict was {recorded.verdict} and is {again.verdict}"
            return replace(self, state=DIFFERENT, reason=words)
        before, after = _figures(recorded), _figures(again)
        if np.array_equal(before, after, equal_nan=True):
            return replace(self, state=SAME)
        if len(before) != len(after):
            return replace(self, state=DIFFERENT, reason="the compared quantities differ")
        if np.any(np.isnan(before) != np.isnan(after)):
            what = (
                "faults are unobservable" if again.comparison is None else "quantities are unknown"
            )
            return replace(self, state=DIFFERENT, reason=f"other {what}")
        difference = float(np.nanmax(np.abs(before - after)))
        state = ROUNDED if difference <= _ROUNDING else DIFFERENT
        return replace(self, state=state, reason=by, difference=difference)


def _figures(estimate: Estimate) -> Array:
    """Return the faults and the changes of quantities as an array, ``(n,)``."""
    compared = estimate.comparison
    changes = [quantity.change for quantity in compared.quantities] if compared else []
    return np.array([*estimate.faults, *changes])


class _Recorded(NamedTuple):
    """Recorded estimate, with its window number."""

    number: int
    estimate: Estimate

    @classmethod
    def of_message(cls, message: Any) -> "_Recorded":
        covariance = np.reshape(message.covariance, (N_FAULTS, N_FAULTS))
        # Bags of version 0.1.0 have neither quantities nor causes nor alternatives.
        quantities = tuple(map(quantity_of, getattr(message, "quantities", ())))
        causes = [
            CauseEstimate(cause.name, cause.value, cause.sigma)
            for cause in getattr(message, "causes", ())
        ]
        estimate = Estimate(
            stamp_from_message(message.window_start),
            stamp_from_message(message.window_end),
            message.algorithm,
            int(message.seed),
            message.calibration_id,
            faults=FaultVector.of(faults_from_message(message.faults)),
            covariance=covariance,
            unobservable=np.isnan(np.diag(covariance)),
            goodness_limit=message.goodness_limit,
            valid=message.valid,
            warm_start=message.warm_start,
            verdict=tuple(Verdict)[message.verdict],
            causes=tuple(causes),
            alternatives=tuple(
                Alternative(tuple(pair.part), tuple(pair.stand_in))
                for pair in getattr(message, "alternatives", ())
            ),
            stretches=int(message.stretches),
            comparison=Comparison(quantities) if quantities else None,
        )
        return cls(int(message.window), estimate)


@click.command()
@click.argument("recorded", metavar="BAG|ARCHIVE|HISTORY", type=click.Path(path_type=Path))
@click.option(
    "--calibration",
    "calibration_files",
    type=click.Path(path_type=Path),
    multiple=True,
    help=(
        "A calibration that the monitor used (repeatable); by default calibration.yaml next to "
        "BAG. The shipped calibration and all calibrations of an archive are always available."
    ),
)
@click.option(
    "--bag",
    "bags",
    type=click.Path(path_type=Path),
    multiple=True,
    help="A bag with telemetry of the tests in a HISTORY (repeatable).",
)
@click.option("--json", "as_json", is_flag=True, help="Print a list with an object per estimate.")
def verify(
    recorded: Path, calibration_files: tuple[Path, ...], bags: tuple[Path, ...], as_json: bool
) -> None:
    """Recompute recorded estimates from the recorded telemetry, and compare both.

    An estimate is identical, equal within rounding (another processor or version), different, or
    cannot be recomputed. For a history, the command also reports where it was altered. Exit code 3:
    an estimate is different, a history was altered, or no estimate can be recomputed.
    """
    beside = Identifying().with_calibration_beside([recorded]).calibration_file
    files = calibration_files or tuple(filter(None, [beside]))
    usable = [Calibration.builtin(), *map(load_calibration, files)]
    by_id = {calibration.calibration_id: calibration for calibration in usable}
    if (recorded / ARCHIVE_FILE).exists():
        verdicts = _of_archive(recorded)
    elif recorded.suffix == ".sqlite":
        verdicts = _of_history(recorded, bags, by_id)
    else:
        verdicts = _of_bag(Bag(recorded), by_id)
    with progress_bar() as progress:
        verdicts = list(progress.track(verdicts, description="recomputing"))
    if not verdicts:
        raise ValueError(f"{recorded} has no estimates: record while a monitor runs (`ema up`)")
    if as_json:
        click.echo(json.dumps([asdict(verdict) for verdict in verdicts]))
    else:
        for verdict in verdicts:
            click.echo(str(verdict))
        counts = Counter(verdict.state for verdict in verdicts)
        click.echo(", ".join(f"{count} {state}" for state, count in counts.items()))
    states = {verdict.state for verdict in verdicts}
    if states & {DIFFERENT, ALTERED} or states == {CANNOT}:
        sys.exit(REFUSED)


def _of_bag(bag: Bag, calibrations: Mapping[str, AnyCalibration]) -> Iterator[Verified]:
    for actuator_id in described_actuators(bag):
        messages = (item.message for item in bag.messages(bag.topics_of(ESTIMATE_TYPE)))
        tests = [
            _Recorded.of_message(message)
            for message in messages
            if message.actuator_id == actuator_id
        ]
        yield from _recomputed(actuator_id, tests, _windows(bag, actuator_id), calibrations)


def _of_history(
    path: Path, bags: Sequence[Path], calibrations: Mapping[str, AnyCalibration]
) -> Iterator[Verified]:
    history, damage = read_intact_history(path)
    actuator_id = history.unit[0]
    if damage:
        yield Verified(actuator_id, None, ALTERED, reason=damage)
    windows: dict[tuple[int, int], RecordedWindow] = {}
    for bag in bags:
        windows |= _windows(Bag(bag), actuator_id)
    entries = sorted([*history.entries, *history.late], key=lambda entry: entry.stamp_ns)
    estimates = (moved(entry.estimate, -entry.shift_ns) for entry in entries)
    tests = [_Recorded(number, estimate) for number, estimate in enumerate(estimates)]
    yield from _recomputed(actuator_id, tests, windows, calibrations)


def _of_archive(folder: Path) -> Iterator[Verified]:
    """Yield the result for each row of an archive; bags are recomputed as in `ema archive run`."""
    with Manifest(folder, writes=False) as manifest:
        for task, sha256, software in manifest.done():
            again = diagnose_bag(task)
            rows = [row for part in again.units for row in part.estimates]
            made = {(row["actuator_id"], row["end_ns"]): estimate_from(row) for row in rows}
            why = "its window is missing from the bag"
            if again.state != DONE:
                why = again.reason
            elif again.sha256 != sha256:
                made, why = {}, "the bag was changed later"
            for row in manifest.estimates_of(task.url):
                verified = Verified(row["actuator_id"], row["number"], bag=task.url)
                estimate = made.get((row["actuator_id"], row["end_ns"]))
                if estimate is None:
                    yield replace(verified, reason=why)
                elif row["calibration_id"] != estimate.calibration_id:
                    words = f"calibration {row['calibration_id']!r} is missing"
                    yield replace(verified, reason=words)
                else:
                    by = (
                        ""
                        if software == estimation_software()
                        else "computed by a different software version"
                    )
                    yield verified.compared(estimate_from(row), estimate, by)


def _windows(bag: Bag, actuator_id: str) -> dict[tuple[int, int], RecordedWindow]:
    """Return an actuator's windows in a bag, keyed by their first and last timestamps [ns]."""
    windows = find_recorded_windows(read_telemetry(bag, None, actuator_id)).windows
    return {(window.start_ns, window.end_ns): window for window in windows}


def _recomputed(
    actuator_id: str,
    tests: Sequence[_Recorded],
    windows: Mapping[tuple[int, int], RecordedWindow],
    calibrations: Mapping[str, AnyCalibration],
) -> Iterator[Verified]:
    """Yield the result for each estimate of an actuator, recomputed in order from its window."""
    earlier, last, is_whole = Diagnosis(), "", False
    before_last, last_number = Diagnosis(), -1
    described = next(iter(windows.values()), None)
    for number, test in tests:
        verified = Verified(actuator_id, number)
        window = windows.get((test.start_ns, test.end_ns))
        calibration = calibrations.get(test.calibration_id)
        is_continued = last == test.calibration_id
        before = earlier.stopped() if test.warm_start else Diagnosis()
        # Windows are counted from the start of a monitor.
        has_restarted = test.warm_start and number <= last_number
        without_last, last_number = before_last if has_restarted else None, number
        described = window or described
        if described is not None and test.valid:
            before_last = earlier.stopped()
            earlier.begin_at(described.description, test)
            is_whole = (is_whole and is_continued) or not test.warm_start
            last = test.calibration_id
        if test.stretches:
            yield replace(verified, reason="it combines stretches of ordinary motion")
        elif test.verdict == Verdict.SKIPPED:
            yield replace(verified, reason="its window was truncated or dropped")
        elif window is None:
            yield replace(verified, reason="its window is in none of the bags")
        elif calibration is None:
            words = (
                f"calibration {test.calibration_id or 'unknown'} is missing: pass it by "
                "--calibration"
            )
            yield replace(verified, reason=words)
        elif test.warm_start and not is_continued:
            yield replace(verified, reason="its search started from a missing estimate")
        else:
            verified = _of_any_start(verified, test, before, without_last, window, calibration)
            if verified.state == DIFFERENT and test.warm_start and not is_whole:
                words = "it depends on tests before the first available test"
                verified = replace(verified, state=CANNOT, reason=words)
            yield verified


def _of_any_start(
    verified: Verified,
    recorded: Estimate,
    before: Diagnosis,
    without_last: Diagnosis | None,
    window: RecordedWindow,
    calibration: AnyCalibration,
) -> Verified:
    """Compare an estimate with the results of monitors that started at different times.

    Return the result of the best agreement.

    A monitor that started during a motion does not know the motor's initial position in the play. A
    monitor that was killed may have published a test that is missing from its history; its next
    search then started from the state ``without_last``.
    """
    search = SearchSettings(
        recorded.algorithm, seed=recorded.seed, goodness_limit=recorded.goodness_limit
    )
    results = list[Verified]()
    for diagnosis, memory in ((before, ""), (without_last, "without the previous test")):
        if diagnosis is None:
            continue
        for seen, play in _seen_by_a_monitor(window):
            *_, repeated = diagnosis.stopped().add(seen, calibration, search)
            assert isinstance(repeated, Diagnosed)
            result = verified.compared(recorded, repeated.estimate)
            words = ", ".join(filter(None, [play, memory]))
            if words and result.state in (SAME, ROUNDED):
                result = replace(result, reason=f"as from a monitor started {words}")
            if result.state == SAME or (result.state == ROUNDED and not words):
                return result
            results.append(result)
    return next((result for result in results if result.state == ROUNDED), results[0])


def _seen_by_a_monitor(window: RecordedWindow) -> Iterator[tuple[RecordedWindow, str]]:
    """Yield a window as recorded, then as received by monitors that started at other times.

    Each window comes with the time at which such a monitor started, as a phrase.
    """
    yield window, ""
    if window.play is not None:
        yield replace(window, play=None), "during the motion before the window"
    elif window.description.is_modelled:
        for play in (1.0, -1.0):
            yield replace(window, play=play), "before the recording"
