"""Options that say how to identify, shared by the commands that do."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import click

from ema_cli.errors import NameChoice
from ema_cli.gathered_options import gathered
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.calibrations import AnyCalibration, load_calibration
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.identification.fitness import FITNESS
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.identification.tally import CombinationSettings
from ema_monitor.optimizers import ALGORITHMS

_ALGORITHM = click.option(
    "--algorithm",
    default=SearchSettings.algorithm,
    type=NameChoice("algorithm", ALGORITHMS),
)
_SEARCH = (
    click.option("--fitness", default=SearchSettings.fitness, type=NameChoice("fitness", FITNESS)),
    click.option(
        "--budget",
        default=SearchSettings.budget,
        type=click.IntRange(1),
        help="Largest number of model evaluations a window.",
    ),
    click.option(
        "--goodness-limit",
        default=SearchSettings.goodness_limit,
        type=click.FloatRange(0.1, 1e6),
        help="Goodness of fit beyond which an estimate is degraded, or refused where most is "
        "unexplained; more for a shorted motor.",
    ),
    click.option("--seed", default=0, type=click.IntRange(0), help="Of the algorithm."),
)
SEARCH_OPTIONS: Final = (_ALGORITHM, *_SEARCH)
"""How each window is searched."""

_OF_A_SERIES = (
    _ALGORITHM,
    click.option(
        "--warm-start/--no-warm-start",
        default=SearchSettings.warm_start,
        help="Begin each search at the faults of the actuator's last valid estimate.",
    ),
    click.option(
        "--wanted-sigma",
        default=CombinationSettings.wanted_sigma,
        help="With --any-motion: standard deviation of each fault at which an estimate is made.",
    ),
    click.option(
        "--most-stretches",
        default=CombinationSettings.most_stretches,
        help="With --any-motion: after so many stretches an estimate is made in any case.",
    ),
    click.option(
        "--longest-s",
        default=CombinationSettings.longest_s,
        help="With --any-motion: after so much time an estimate is made in any case [s].",
    ),
    click.option(
        "--pause-s",
        default=CombinationSettings.pause_s,
        help="With --any-motion: motion within this time after an estimate is passed over [s].",
    ),
)
_OF_EACH_SEARCH = (
    *_SEARCH,
    click.option(
        "--calibration",
        "calibration_file",
        type=click.Path(path_type=Path, dir_okay=False),
        help="File made by `ema calibrate`; without it that of the built-in actuator.",
    ),
)


@dataclass(frozen=True)
class IdentificationOptions:
    """What the options say.

    Attributes
    ----------
    calibration_file
        File of the calibration; None for the shipped one.
    combining
        Until when stretches of ordinary motion are combined.
    """

    search: SearchSettings
    calibration_file: Path | None
    combining: CombinationSettings = CombinationSettings()  # noqa: RUF009 - frozen

    def calibration(self) -> AnyCalibration:
        """Return the calibration that the options name.

        Raises
        ------
        ValueError
            When the file is no calibration.
        OSError
            When it cannot be read.
        """
        if self.calibration_file is None:
            return Calibration.builtin()
        return load_calibration(self.calibration_file)

    def calibration_of_model(self) -> Calibration:
        """Return the calibration that the options name, of a drive that is modelled.

        Raises
        ------
        ValueError, OSError
            As of `calibration`; also when it is that of an unknown drive.
        """
        calibration = self.calibration()
        if isinstance(calibration, UnknownDriveUnit):
            raise ValueError(
                f"{self.calibration_file} is the calibration of an unknown drive, of which there "
                "is no model to compare or draw; `ema estimate` and `ema report` give its figures"
            )
        return calibration

    @property
    def calibration_source(self) -> str:
        """Where the calibration comes from, in words."""
        return str(self.calibration_file or "the shipped one of the built-in actuator")


def _build(*, calibration_file: Path | None, **given: Any) -> IdentificationOptions:
    names = CombinationSettings.__annotations__
    combining = CombinationSettings(**{name: given.pop(name) for name in names if name in given})
    return IdentificationOptions(SearchSettings(**given), calibration_file, combining)


_NAMES = (
    *SearchSettings.__annotations__,
    *CombinationSettings.__annotations__,
    "calibration_file",
)

identification_options = gathered("options", _build, _NAMES, (*_OF_A_SERIES, *_OF_EACH_SEARCH))
"""Gives a command the options as ``options``."""

comparison_options = gathered("options", _build, _NAMES, _OF_EACH_SEARCH)
"""Gives a command those that are the same for every algorithm; its searches begin cold."""
