"""What a recording lacks, as it could not be written or nobody received it: in its metadata."""

from dataclasses import dataclass
from typing import Final

from ema_core.wording import counted

# The name that it has in all bags, also of before the package was renamed.
GAP: Final = "ema_recording gap"
"""Name of the metadata record of a file that tells of a gap before it."""


@dataclass
class Gap:
    """Messages that were not recorded.

    Attributes
    ----------
    reason
        Why, in words.
    start_ns, end_ns
        Log times of the first and the last of them [ns], or between which they would be.
    count
        How many were received; 0 where none was, and nobody knows how many were published.
    """

    reason: str
    start_ns: int
    end_ns: int
    count: int = 0

    def add(self, log_time_ns: int) -> None:
        """Count a message."""
        self.start_ns = min(self.start_ns, log_time_ns)
        self.end_ns = max(self.end_ns, log_time_ns)
        self.count += 1

    def __str__(self) -> str:
        span = f"from {self.start_ns / 1e9:.3f} s to {self.end_ns / 1e9:.3f} s"
        if not self.count:
            return f"messages {span} may be missing: {self.reason}"
        return f"{counted(self.count, 'message')} {span} not recorded: {self.reason}"
