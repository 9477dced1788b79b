"""What happens to a unit or to its monitoring, with its kind."""

from dataclasses import dataclass
from typing import Final, NamedTuple

FAULT: Final = "fault"
CALIBRATION: Final = "calibration"
RESTART: Final = "restart"
GAP: Final = "gap"
SERVICE_HOURS: Final = "service hours"
HISTORY: Final = "history"
OTHER: Final = "other"


class Finding(NamedTuple):
    """What a test reveals: its kind, as in ``ema_interfaces/msg/UnitEvent``, and words."""

    kind: str
    text: str


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

    def __str__(self) -> str:
        return f"{self.kind}: {self.text}"
