# SPDX-License-Identifier: Apache-2.0
"""A point in time on both clocks of a receiving node."""

from typing import NamedTuple


class Moment(NamedTuple):
    """A point in time on the stamp clock and on a steady clock."""

    clock_ns: int
    """Time on the clock used for message stamps [ns]."""

    steady_ns: int
    """Time on a monotonic clock [ns]; 0 until simulated time starts."""

    passed_ns: int = 0
    """Latest stamp-clock time before the clock stepped back [ns]; 0 without a step."""

    is_continued: bool = False
    """Whether clock steps are detected across restarts of the node."""

    is_real: bool = True
    """False for simulated time, which a playback sets and which may lag behind stamps."""
