# SPDX-License-Identifier: Apache-2.0
"""Writing of picture files."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from matplotlib import rc_context
from matplotlib.figure import Figure

from ema_cli.output import output_option
from ema_cli.parameters import Command
from ema_core.files import complete_file

PICTURES: Final = (".png", ".svg", ".pdf")
"""Permitted suffixes of picture files."""


def picture_option(default: str = "") -> Callable[[Command], Command]:
    """Return the options for an output picture; ``default`` describes the default path."""
    return output_option(
        f"Picture to write ({', '.join(PICTURES)}){default}", required=False, dir_okay=False
    )


def save_picture(figure: Figure, picture: Path, dpi: int = 120) -> None:
    """Write a figure atomically to a picture file; the suffix selects the format."""
    # Long lines are drawn in pieces, because the memory for a line grows with its strokes.
    with complete_file(picture) as partial, rc_context({"agg.path.chunksize": 1000}):
        figure.savefig(partial, dpi=dpi, format=picture.suffix.lower().removeprefix("."))
