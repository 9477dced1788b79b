"""Figures of whole moves, of drives that log no samples."""

from collections.abc import Mapping
from typing import NamedTuple


class Move(NamedTuple):
    """Figures of one move, or the medians of several alike, by name; all are positive.

    The stamp is that of the first of them [ns].
    """

    stamp_ns: int
    figures: Mapping[str, float]
