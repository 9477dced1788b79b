"""What the history of an actuator tells of, besides growth."""

from dataclasses import dataclass
from typing import Final

REPAIR: Final = "repair"
STEP: Final = "step"
OUTLIER: Final = "outlier"


@dataclass(frozen=True)
class Event:
    """Something that growth does not explain.

    Attributes
    ----------
    kind
        ``"outlier"``: a value that no growth explains, held back until the next test. When that
        test agrees with it, a ``"repair"`` (the fault became smaller) or a ``"step"`` (it became
        larger) follows; else it stays an outlier and is never used.
    component
        Component of the fault vector.
    hours
        Service hour at which it was first seen [h].
    text
        What was seen, in words.
    """

    kind: str
    component: str
    hours: float
    text: str
