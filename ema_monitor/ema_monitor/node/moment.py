"""A time, by both clocks of a node that receives telemetry."""

from typing import NamedTuple


class Moment(NamedTuple):
    """A time by the clock of stamps and by a steady clock."""

    clock_ns: int
    """Time by the clock of stamps [ns]."""

    steady_ns: int
    """Time by a clock that never goes back [ns]; 0 until simulated time begins."""

    passed_ns: int = 0
    """Latest time shown by the clock of stamps before it stepped back [ns]; 0 without a step."""

    is_continued: bool = False
    """Whether steps that occur while the node does not run are detected as well."""

    is_real: bool = True
    """False for simulated time, which a playback sets and which may lag behind stamps."""
