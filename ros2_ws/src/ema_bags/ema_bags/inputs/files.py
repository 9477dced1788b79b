# SPDX-License-Identifier: Apache-2.0
"""Opening of third-party files and bags."""

from pathlib import Path

from ema_bags.inputs.bags import is_bag
from ema_bags.inputs.input_bag import InputBag
from ema_bags.inputs.input_file import InputFile
from ema_bags.inputs.input_table import InputTable
from ema_bags.inputs.lerobot import is_data_set
from ema_bags.inputs.mapping import ColumnMapping


def open_input(path: Path, mapping: ColumnMapping | None = None) -> InputFile:
    """Open a table, a LeRobot data set, or a bag.

    Parameters
    ----------
    path
        Path of the file, or folder of the bag or data set.
    mapping
        Mapping that defines the CSV format; None to detect it.

    Raises
    ------
    ValueError
        If the file cannot be read.
    OSError
        If the file cannot be opened.
    """
    if not path.exists():
        raise FileNotFoundError(2, "no such file", str(path))
    is_table = is_data_set(path) or not is_bag(path)
    return InputTable(path, mapping) if is_table else InputBag(path)
