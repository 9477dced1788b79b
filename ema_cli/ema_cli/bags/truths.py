"""Which recorded true faults a window has."""

from bisect import bisect_right
from collections.abc import Sequence

from ema_ros.faults import StampedFaults


def truth_at(truths: Sequence[StampedFaults], start_ns: int) -> StampedFaults | None:
    """Return the true faults of the test cycle that runs at a time; None before the first.

    Parameters
    ----------
    truths
        True faults of one actuator by test cycle, in order.
    start_ns
        Start of a window [ns].
    """
    before = bisect_right(truths, start_ns, key=lambda truth: truth.stamp_ns)
    return truths[before - 1] if before else None
