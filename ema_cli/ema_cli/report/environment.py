"""What the pages of reports are made with."""

import math
from typing import Final

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from ema_cli.show.levels import SHAPES
from ema_core.levels import LEVEL_NAMES

SHAPES_BY_NAME: Final = {LEVEL_NAMES[level]: shape for level, shape in SHAPES.items()}
"""A shape for each level, by its name."""


def template(name: str) -> Template:
    """Return a template, which may show figures by the filter ``figure``."""
    environment = Environment(
        loader=PackageLoader("ema_cli.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"figure": _figure}
    return environment.get_template(name)


def _figure(value: float | None, form: str = "z.4f", scale: float = 1.0) -> Markup:
    """Return a figure rounded for the eye, and exactly for programs."""
    if value is None or not math.isfinite(value):
        return Markup("–")
    return Markup('<data value="{}">{}</data>').format(value, f"{scale * value:{form}}")
