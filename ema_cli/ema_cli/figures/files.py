"""Pictures as files."""

from collections.abc import Callable, Iterable
from pathlib import Path

from matplotlib import rc_context
from matplotlib.backend_bases import FigureCanvasBase
from matplotlib.figure import Figure

from ema_cli.output import output_option, require_free
from ema_cli.parameters import Command
from ema_core.files import complete_file


def picture_option(default: str = "") -> Callable[[Command], Command]:
    """Return the options of a picture to write; ``default`` describes its place by default."""
    return output_option(
        f"Picture to write (.png, .svg, .pdf){default}", required=False, dir_okay=False
    )


def require_drawable(picture: Path, inputs: Iterable[Path], *, overwrite: bool) -> None:
    """Refuse a picture that may not or could not be written, before the work, not after it."""
    known = FigureCanvasBase.get_supported_filetypes()
    if picture.suffix.lower().removeprefix(".") not in known:
        raise ValueError(f"{picture}: a picture ends in one of .png, .svg, .pdf")
    if not picture.parent.is_dir():
        raise ValueError(f"{picture}: there is no folder {picture.parent}")
    require_free(picture, inputs, overwrite=overwrite)


def save_picture(figure: Figure, picture: Path, dpi: int = 120) -> None:
    """Write a picture whole or not at all."""
    # In pieces: a long line that fills an area is drawn in memory of the size of its strokes.
    with complete_file(picture) as partial, rc_context({"agg.path.chunksize": 1000}):
        figure.savefig(partial, dpi=dpi, format=picture.suffix.lower().removeprefix("."))
