"""What a recording lacks, as it could not be written or nobody received it: in its metadata."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final, Self

from ema_core.wording import counted

# The name that it has in all bags, also of before the package was renamed.
GAP: Final = "ema_recording gap"
"""Name of the metadata record that describes a gap before it in a file."""


@dataclass
class Gap:
    """Messages that were not recorded.

    Attributes
    ----------
    reason
        Why, in words.
    start_ns, end_ns
        Log times of the first and the last of them [ns], or between which they would be.
    messages
        How many were received; 0 where none was, and nobody knows how many were published.
    """

    reason: str
    start_ns: int
    end_ns: int
    messages: int = 0

    @classmethod
    def from_metadata(cls, record: Mapping[str, str]) -> Self:
        """Return the gap of a metadata record; KeyError or ValueError if it is not one."""
        numbers = (int(record[key]) for key in ("start_ns", "end_ns", "messages"))
        return cls(record.get("reason", ""), *numbers)

    def as_metadata(self) -> dict[str, str]:
        """Return the record of a gap."""
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
