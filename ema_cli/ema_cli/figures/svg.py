"""Pictures as SVG within a page: small, with text as text, in the colours of the page."""

import io
import re
from typing import Any, Final
from xml.sax.saxutils import escape

from matplotlib import rc_context
from matplotlib.figure import Figure

from ema_monitor.plot.style import INK

_SETTINGS: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "ema",
    # Half a dot of a screen: a window of 5,000 samples has ten of them on each.
    "path.simplify_threshold": 0.5,
}
_DECIMALS: Final = 1
"""A figure is 756 points wide, so that a tenth of one is not seen."""

_NUMBER: Final = re.compile(r"-?\d+\.\d+")
_PATH: Final = re.compile(r'(?<= d=")[^"]+')
_PLACE: Final = re.compile(r'(?<= (?:x|y)=")-?\d+\.\d+|(?<=translate\()[^)]+')
_FONT: Final = re.compile(r"(font(?:-family)?: [^;\"]*?)'[^;\"]*sans-serif")
# It would hold for all of the page.
_STYLE: Final = re.compile(r"<defs><style[^>]*>.*?</style></defs>", re.DOTALL)
_NAME: Final = re.compile(r'( id="|href="#|url\(#)')
# Black is that of words and frames.
_INKS: Final = re.compile(rf"#000000|{INK}", re.IGNORECASE)


def inline_svg(figure: Figure, name: str, title: str, description: str) -> str:
    """Return a figure as an ``svg`` element that needs nothing beside it."""
    file = io.StringIO()
    with rc_context(_SETTINGS):
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    text = file.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = _PATH.sub(lambda found: _rounded(found[0].replace("\n", "")), text)
    text = _PLACE.sub(lambda found: _rounded(found[0]), text)
    text = _FONT.sub(r"\1sans-serif", text)
    text = _INKS.sub("currentColor", text)
    text = _NAME.sub(rf"\g<1>{name}-", text.replace("xlink:href", "href"))
    text = _STYLE.sub("", re.sub(r">\s+<", "><", text)).strip()
    width, height = (round(72.0 * inches) for inches in figure.get_size_inches())
    told = (
        f'<svg viewBox="0 0 {width} {height}" fill="currentColor" stroke-linejoin="round" '
        f'role="img" aria-labelledby="{name}-title {name}-description">'
        f'<title id="{name}-title">{escape(title)}</title>'
        f'<desc id="{name}-description">{escape(description)}</desc>'
    )
    return re.sub(r"<svg[^>]*>", lambda _: told, text, count=1)


def _rounded(numbers: str) -> str:
    return _NUMBER.sub(lambda found: f"{round(float(found[0]), _DECIMALS):g}", numbers)
