"""Estimates of the windows in a bag, with a progress bar, and as plain values."""

from collections.abc import Sequence
from typing import Any

import click

from ema_bags.windows import BagWindows, RecordedWindow
from ema_cli.identification_options import IdentificationOptions
from ema_cli.show.progress import progress_bar
from ema_monitor.calibrations import AnyCalibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import Estimate, by_fault, estimate_record
from ema_monitor.model.monitor_model import compile_kernels
from ema_monitor.windows.window import MIN_TRAVEL


def estimate_windows(
    windows: Sequence[RecordedWindow],
    calibration: AnyCalibration,
    options: IdentificationOptions,
    *,
    force: bool = False,
    any_motion: bool = False,
) -> list[Estimate]:
    """Return the estimates of one actuator's windows, as a monitor makes them.

    Parameters
    ----------
    any_motion
        Whether the windows are stretches of ordinary motion, which are combined; what became of
        them is printed.
    """
    # So that the computing time of the first estimate is that of an estimate.
    compile_kernels([calibration.form])
    diagnosis, found = Diagnosis(), list[Diagnosed]()
    combining = options.combining if any_motion else None
    with progress_bar() as progress:
        task = progress.add_task("identifying", total=len(windows))
        for number, window in enumerate(windows, 1):
            for one in diagnosis.add(window, calibration, options.search, combining, force=force):
                if isinstance(one, Diagnosed):
                    found.append(one)
                else:
                    progress.update(
                        task,
                        state=f"window {number} of {len(windows)}, {one.evaluations} evaluations, "
                        f"fitness {one.fitness:.5f} A^2.s",
                    )
            progress.advance(task)
    found += diagnosis.finish()
    if any_motion and windows:
        click.echo(f"{windows[0].description.actuator_id}: {diagnosis.tally}", err=True)
    return [one.estimate for one in found]


def as_object(one: Estimate, found: BagWindows) -> dict[str, Any]:
    """Return an estimate as plain values; what is not a number is null."""
    record = estimate_record(one)
    record["play_offset"] = record.pop("play")
    record["calibration"] = record.pop("calibration_id")
    return record | {
        "sigma": by_fault(one.sigma),
        "excitation_limit": MIN_TRAVEL,
        "start": round(found.seconds(one.start_ns), 9),
        "end": round(found.seconds(one.end_ns), 9),
    }
