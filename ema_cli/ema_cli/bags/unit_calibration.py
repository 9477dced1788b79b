"""The calibration that lies beside the bags of a unit."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

from ema_cli.bags.unit_record import find_bags
from ema_cli.identification_options import IdentificationOptions

CALIBRATION_FILE: Final = "calibration.yaml"
"""Name of the calibration of the unit whose bags lie in the same folder."""


def with_calibration_beside(
    options: IdentificationOptions, paths: Iterable[Path]
) -> IdentificationOptions:
    """Return options that name the calibration beside the bags, where they name none themselves.

    Parameters
    ----------
    options
        What the options say.
    paths
        Bags and folders of bags of one unit.

    Raises
    ------
    ValueError
        When there is more than one calibration, or a folder holds no bag.
    """
    if options.calibration_file is not None:
        return options
    folders = {bag.parent.resolve(): bag.parent for bag in find_bags(paths)}
    files = [path for folder in folders.values() if (path := folder / CALIBRATION_FILE).is_file()]
    if len(files) > 1:
        raise ValueError(
            f"{files[0]} and {files[1]} both lie beside the bags: choose one with --calibration"
        )
    return replace(options, calibration_file=files[0]) if files else options
