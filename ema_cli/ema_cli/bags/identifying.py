# SPDX-License-Identifier: Apache-2.0
"""Identification of the windows in a bag: command options, and computation of the estimates."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import click

from ema_cli.bags.reading import MEASURED_OPTION, ReadingOptions, accept_option
from ema_cli.options import NameChoice
from ema_cli.parameters import Command, Parameters
from ema_cli.progress import progress_bar
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import CALIBRATION_FILE, AnyCalibration, load_calibration
from ema_monitor.diagnosis import Diagnosed, Diagnosis
from ema_monitor.identification.estimate import Estimate, by_fault, estimate_record
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.model.monitor_model import compile_kernels
from ema_monitor.optimizers import ALGORITHMS
from ema_monitor.recordings.windows import BagWindows, RecordedWindow
from ema_monitor.windows.window import MIN_TRAVEL

ALGORITHM_OPTION: Final = click.option(
    "--algorithm",
    type=NameChoice("algorithm", ALGORITHMS),
    metavar="NAME",
    help=f"Algorithm: {', '.join(ALGORITHMS)}; by default {SearchSettings.algorithm}.",
)
SEED_OPTION: Final = click.option(
    "--seed", type=click.IntRange(0), metavar="N", help="Seed of the algorithm."
)


@dataclass(frozen=True)
class Identifying(ReadingOptions):
    """Command options that select the part of a bag to read, and set the identification."""

    OPTIONS: ClassVar[tuple[Callable[[Command], Command], ...]] = (
        *ReadingOptions.OPTIONS,
        accept_option("Accept --actuator or --calibration of another unit."),
        MEASURED_OPTION,
        SEED_OPTION,
        click.option(
            "--no-memory",
            "memory",
            flag_value=False,
            default=None,
            help="Identify windows independently of earlier tests.",
        ),
        click.option(
            "--calibration",
            "calibration_file",
            type=click.Path(path_type=Path, dir_okay=False),
            help="Default: calibration.yaml next to BAG, or shipped.",
        ),
    )
    SECTIONS: ClassVar[tuple[tuple[Any, str], ...]] = (
        *ReadingOptions.SECTIONS,
        (SearchSettings, ""),
        (CombinationSettings, ""),
    )

    calibration_file: Path | None = None
    """Calibration file; None for the shipped calibration."""
    search: SearchSettings = SearchSettings()  # noqa: RUF009 - frozen
    combining: CombinationSettings = CombinationSettings()  # noqa: RUF009 - frozen
    """Settings of the combination of ordinary motion."""

    @classmethod
    def of(cls, parameters: Parameters, **options: Any) -> Self:
        """Build the settings from options and parameters. Raises ValueError for invalid values."""
        file = options.pop("calibration_file") or parameters.path("calibration_file")
        return super().of(
            parameters,
            **options,
            calibration_file=file,
            search=parameters.over(SearchSettings()),
            combining=parameters.over(CombinationSettings()),
        )

    def with_calibration_beside(self, bags: Iterable[Path]) -> Self:
        """Return the options with the calibration in the bags' folder, unless one is set.

        Raises
        ------
        ValueError
            If several folders of the bags have a calibration.
        """
        if self.calibration_file is not None:
            return self
        folders = {bag.parent.resolve(): bag.parent for bag in bags}
        paths = [folder / CALIBRATION_FILE for folder in folders.values()]
        files = [path for path in paths if path.is_file()]
        if len(files) > 1:
            raise ValueError(
                f"{files[0]} and {files[1]} are both next to the bags: select one with "
                "--calibration"
            )
        return replace(self, calibration_file=files[0] if files else None)

    def calibration(self) -> AnyCalibration:
        """Read the calibration. Raises ValueError or OSError if its file cannot be used."""
        file = self.calibration_file
        return Calibration.builtin() if file is None else load_calibration(file)

    def calibration_of_model(self) -> Calibration:
        """Return the calibration. Raises ValueError if it is unusable or has no drive model."""
        calibration = self.calibration()
        if isinstance(calibration, Calibration):
            return calibration
        raise ValueError(
            f"{self.calibration_file} is a calibration for an unknown drive, which has no model "
            "to compare or draw; use `ema estimate` or `ema report`"
        )

    @property
    def calibration_source(self) -> str:
        """Path of the calibration, or a phrase for the shipped calibration."""
        return str(self.calibration_file or "shipped, for the built-in actuator")

    def estimate(
        self, windows: Sequence[RecordedWindow], calibration: AnyCalibration
    ) -> list[Estimate]:
        """Return the estimates for the windows of an actuator, as a monitor would compute them.

        Stretches of ordinary motion are combined; their number is printed on standard error.
        """
        # Compile first, so that the computing time of the first estimate excludes compilation.
        compile_kernels([calibration.form])
        diagnosis, estimates = Diagnosis(), list[Diagnosed]()
        combining = self.combining if self.any_motion else None
        with progress_bar() as progress:
            task = progress.add_task("identifying", total=len(windows))
            for number, window in enumerate(windows, 1):
                for result in diagnosis.add(
                    window, calibration, self.search, combining, force=self.accept_defects
                ):
                    if isinstance(result, Diagnosed):
                        estimates.append(result)
                    else:
                        progress.update(
                            task,
                            state=f"window {number} of {len(windows)}, {result.evaluations} "
                            f"evaluations, fitness {result.fitness:.5f} A^2.s",
                        )
                progress.advance(task)
        estimates += diagnosis.finish()
        if self.any_motion and windows and isinstance(calibration, Calibration):
            click.echo(f"{windows[0].description.actuator_id}: {diagnosis.tally}", err=True)
        return [estimate.estimate for estimate in estimates]


def as_object(estimate: Estimate, bag_windows: BagWindows) -> dict[str, Any]:
    """Return an estimate as plain values for JSON; NaN becomes None."""
    return estimate_record(estimate) | {
        "sigma": by_fault(estimate.sigma),
        "excitation_limit": MIN_TRAVEL,
        "start": round(bag_windows.seconds(estimate.start_ns), 9),
        "end": round(bag_windows.seconds(estimate.end_ns), 9),
    }
