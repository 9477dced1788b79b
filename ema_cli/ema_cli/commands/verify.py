"""``ema verify``: recorded estimates, made again from the recorded telemetry."""

import json
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from ema_bags.reader import Bag
from ema_bags.telemetry import ESTIMATE_TYPE, described_actuators, read_telemetry
from ema_bags.windows import RecordedWindow, find_recorded_windows
from ema_cli.errors import REFUSED, one_clear_line
from ema_cli.show.progress import progress_bar
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration, load_calibration
from ema_monitor.diagnosis import identify
from ema_monitor.identification.estimate import SKIPPED, VERDICTS
from ema_monitor.identification.settings import SearchSettings
from ema_ros.messages import faults_from_message
from ema_ros.stamps import stamp_from_message

SAME: Final = "same to the bit"
ROUNDED: Final = "same within rounding"
DIFFERENT: Final = "different"
CANNOT: Final = "cannot be made again"

_ROUNDING: Final = 1e-6


@dataclass(frozen=True)
class Verified:
    """What became of a recorded estimate: ``state``, and the largest difference of a fault [-]."""

    actuator_id: str
    window: int
    state: str
    difference: float = 0.0
    reason: str = ""

    def __str__(self) -> str:
        words = f"{self.actuator_id}, window {self.window}: {self.state}"
        if self.state in (ROUNDED, DIFFERENT) and self.difference:
            words += f", by {self.difference:.2g} at most"
        return f"{words} ({self.reason})" if self.reason else words


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "--calibration",
    "calibration_files",
    type=click.Path(path_type=Path),
    multiple=True,
    help="A calibration that the monitor used; may be repeated; default: the shipped one.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one list, an object an estimate.")
def verify(bag: Path, calibration_files: tuple[Path, ...], as_json: bool) -> None:
    """Make each estimate in BAG again from the telemetry in it, and compare both.

    An estimate is the same to the bit, the same within rounding (another processor or version),
    different, or cannot be made again. Exit code 3 where one is different, or none can be made.
    """
    with one_clear_line():
        known = [load_calibration(file) for file in calibration_files]
        by_id = {one.calibration_id: one for one in known or [Calibration.builtin()]}
        recording = Bag(bag)
        found = [
            one
            for actuator_id in described_actuators(recording)
            for one in _verified(recording, actuator_id, by_id)
        ]
        if not found:
            raise ValueError(f"{bag} holds no estimates: expected a bag of a monitor's recorder")
    if as_json:
        click.echo(json.dumps([asdict(one) for one in found]))
    else:
        for one in found:
            click.echo(str(one))
        counts = Counter(one.state for one in found)
        click.echo(", ".join(f"{count} {state}" for state, count in counts.items()))
    states = {one.state for one in found}
    if DIFFERENT in states or states == {CANNOT}:
        sys.exit(REFUSED)


def _verified(
    bag: Bag, actuator_id: str, calibrations: dict[str, AnyCalibration]
) -> list[Verified]:
    """Return what becomes of the estimates of an actuator."""
    messages = [
        item.message
        for item in bag.messages(bag.topics_of(ESTIMATE_TYPE))
        if item.message.actuator_id == actuator_id
    ]
    windows = find_recorded_windows(read_telemetry(bag, None, actuator_id)).windows
    by_stamps = {(one.start_ns, one.end_ns): one for one in windows}
    found, previous = [], None
    with progress_bar() as progress:
        for message in progress.track(messages, description=f"making again {actuator_id}"):
            window = by_stamps.get(
                (stamp_from_message(message.window_start), stamp_from_message(message.window_end))
            )
            found.append(_made_again(message, window, calibrations, previous))
            if message.valid:
                previous = message
    return found


def _made_again(
    message: Any,
    window: RecordedWindow | None,
    calibrations: dict[str, AnyCalibration],
    previous: Any,
) -> Verified:
    """Compare an estimate with one that is made of its window."""

    def told(state: str, reason: str = "", difference: float = 0.0) -> Verified:
        return Verified(message.actuator_id, int(message.window), state, difference, reason)

    verdict = VERDICTS[message.verdict]
    calibration = calibrations.get(message.calibration_id)
    before = None
    if message.stretches:
        return told(CANNOT, "it combines stretches of ordinary motion")
    if verdict == SKIPPED:
        return told(CANNOT, "its window was cut off, or dropped")
    if window is None:
        return told(CANNOT, "its window is not in the bag")
    if calibration is None:
        return told(CANNOT, f"calibration {message.calibration_id or 'unknown'} is not given")
    if message.warm_start:
        if previous is None or previous.calibration_id != message.calibration_id:
            return told(CANNOT, "its search began at an estimate that is not in the bag")
        before = faults_from_message(previous.faults)
    search = SearchSettings(
        algorithm=message.algorithm,
        seed=int(message.seed),
        goodness_limit=message.goodness_limit,
    )
    again = identify(window.window, window.description, calibration, search, previous=before)
    if again.verdict != verdict:
        return told(DIFFERENT, f"the verdict was {verdict} and is {again.verdict}")
    recorded = faults_from_message(message.faults)
    if np.array_equal(recorded, again.faults, equal_nan=True):
        return told(SAME)
    if np.any(np.isnan(recorded) != np.isnan(again.faults)):
        return told(DIFFERENT, "other faults are unobservable")
    difference = float(np.nanmax(np.abs(recorded - again.faults)))
    return told(ROUNDED if difference <= _ROUNDING else DIFFERENT, "", difference)
