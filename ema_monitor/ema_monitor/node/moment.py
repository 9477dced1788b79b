"""A time of a node that receives."""

from typing import NamedTuple


class Moment(NamedTuple):
    """A time.

    Attributes
    ----------
    clock_ns
        By the clock of stamps [ns].
    steady_ns
        By a clock that never goes back [ns]; 0 as long as simulated time has not begun.
    passed_ns
        Latest time that the clock had shown when it stepped back [ns]; 0 if it never did.
    is_continued
        Whether a step while the node did not run is noticed as well.
    is_real
        Whether it is no simulated time, which a playback sets and which may lag behind stamps.
    """

    clock_ns: int
    steady_ns: int
    passed_ns: int = 0
    is_continued: bool = False
    is_real: bool = True
