# SPDX-License-Identifier: Apache-2.0
"""Gaps in a recording: messages that were not received or not written."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final, Self

from ema_core.wording import counted

# Bags written before the package was renamed use this name, so it is kept.
GAP: Final = "ema_recording gap"
"""Name of the MCAP metadata record that describes a gap; the gap precedes the record."""


@dataclass
class Gap:
    """Messages that were not recorded."""

    reason: str
    """Reason why the messages were not recorded."""

    start_ns: int
    """Log time of the first message, or start of the time without reception [ns]."""

    end_ns: int
    """Log time of the last message, or end of the time without reception [ns]."""

    messages: int = 0
    """Number of received messages; 0 if none was received and the number published is unknown."""

    @classmethod
    def from_metadata(cls, record: Mapping[str, str]) -> Self:
        """Return the gap in a metadata record; raise KeyError or ValueError if it has none."""
        numbers = (int(record[key]) for key in ("start_ns", "end_ns", "messages"))
        return cls(record.get("reason", ""), *numbers)

    def as_metadata(self) -> dict[str, str]:
        """Return the gap as a metadata record."""
        return {name: str(value) for name, value in asdict(self).items()}

    def add(self, log_time_ns: int) -> None:
        """Count a message."""
        self.start_ns = min(self.start_ns, log_time_ns)
        self.end_ns = max(self.end_ns, log_time_ns)
        self.messages += 1

    def __str__(self) -> str:
        span = f"from {self.start_ns / 1e9:.3f} s to {self.end_ns / 1e9:.3f} s"
        if not self.messages:
            return f"messages {span} may be missing: {self.reason}"
        return f"{counted(self.messages, 'message')} {span} not recorded: {self.reason}"
