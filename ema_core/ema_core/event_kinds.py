# SPDX-License-Identifier: Apache-2.0
"""Kinds of events of a unit, as in ``ema_interfaces/msg/UnitEvent``, and its largest count."""

from enum import StrEnum
from typing import Final

MOST_COUNT: Final = 2**32 - 1
"""Largest number that ``count`` of ``ema_interfaces/msg/UnitEvent`` can state."""


class EventKind(StrEnum):
    """Kind of an event of a unit or of its monitoring."""

    FAULT = "fault"
    """A fault or requirement reached a higher level, or drive, sensor or shaft failed."""
    DEPARTURE = "departure"
    """The unit differs from its healthy tests."""
    REPAIR = "repair"
    """A fault became abruptly smaller."""
    STEP = "step"
    """A fault became abruptly larger."""
    OUTLIER = "outlier"
    """A value disagrees with earlier tests and is not confirmed yet."""
    CALIBRATION = "calibration"
    """The calibration changed or is unusable."""
    GAP = "gap"
    """Tests or samples are missing."""
    RESTART = "restart"
    """The monitor started or restarted."""
    SERVICE_HOURS = "service_hours"
    """The counts of service hours contradict each other, or are not used."""
    HISTORY = "history"
    """The history could not be read or was begun again."""
    NOTE = "note"
    """A person wrote a note."""
    OTHER = "other"
    """Any other event."""
