"""What happens to a unit or to its monitoring, with its kind: the only place that tells it."""

from dataclasses import dataclass
from typing import Final

FAULT: Final = "fault"
CALIBRATION: Final = "calibration"
RESTART: Final = "restart"
OTHER: Final = "other"

_KINDS: Final = {
    "repair": "repair",
    "step": "step",
    "regime": "regime",
    "outlier": "outlier",
    "missed tests": "gap",
    "service hours": "service hours",
    "usage": "service hours",
    "the history": "history",
}
"""Kinds of events by how they begin in words."""


@dataclass(frozen=True, slots=True)
class UnitEvent:
    """Something that happened to a unit or to its monitoring.

    Attributes
    ----------
    stamp_ns
        Stamp of the test that showed it [ns].
    hours
        Service hours then [h]; NaN when unknown.
    kind
        What kind of event, as in ``ema_interfaces/msg/UnitEvent``.
    text
        In words.
    """

    stamp_ns: int
    hours: float
    kind: str
    text: str


def kind_and_text(words: str) -> tuple[str, str]:
    """Return the kind of an event of an outlook, and its words without that in front."""
    kind = next((kind for start, kind in _KINDS.items() if words.startswith(start)), OTHER)
    return kind, words.removeprefix(f"{kind}: ")
