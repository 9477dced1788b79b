"""Where a picture is to be written."""

from pathlib import Path

from matplotlib.backend_bases import FigureCanvasBase


def require_drawable(picture: Path) -> None:
    """Refuse a picture that could not be written, before the work rather than after it.

    Parameters
    ----------
    picture
        File to write.

    Raises
    ------
    ValueError
        When its ending is no format of pictures, or its folder is not there.
    """
    known = FigureCanvasBase.get_supported_filetypes()
    if picture.suffix.lower().removeprefix(".") not in known:
        raise ValueError(f"{picture}: a picture ends in one of .png, .svg, .pdf")
    if not picture.parent.is_dir():
        raise ValueError(f"{picture}: there is no folder {picture.parent}")
