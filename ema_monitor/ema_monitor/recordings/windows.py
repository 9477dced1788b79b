# SPDX-License-Identifier: Apache-2.0
"""Windows of a recording; their telemetry is read when it is accessed."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.recording import MessagePlace
from ema_bags.telemetry import RecordedTelemetry
from ema_core.causes import CauseEstimate
from ema_core.description import ActuatorDescription, UnitKey
from ema_core.faults import healthy_faults
from ema_core.telemetry import Telemetry, bridged, excerpt
from ema_core.wording import counted
from ema_monitor.reasons import Reason
from ema_monitor.windows.trigger import Refusal
from ema_monitor.windows.window import Window
from ema_ros.messages import StampedFaults

if TYPE_CHECKING:  # an estimate alone needs no prognosis
    from ema_monitor.prognosis.duty.damage import FlownDuty

_KEPT_WINDOWS: Final = 64
_KEPT_SAMPLES: Final = 2_000_000


@dataclass(frozen=True)
class WindowPlace:
    """Position of the samples of a window in a bag."""

    recorded: RecordedTelemetry
    first: MessagePlace
    """Position of the block with the first sample."""
    last: MessagePlace
    """Position of the block with the last sample."""
    offset: int
    """Index of the first sample in the first block."""
    span: int
    """Number of samples, including the omitted samples."""
    omitted: tuple[range, ...] = ()
    """Ranges of running indices that the window leaves out (see `Window`)."""

    @property
    def samples(self) -> int:
        """Number of samples, without the omitted samples."""
        return self.span - sum(map(len, self.omitted))

    def read(self) -> Telemetry:
        """Return the samples, read from the bag; lost samples are interpolated."""
        items = self.recorded.items(self.first, self.last)
        blocks = (item for _, item in items if isinstance(item, Telemetry))
        first = next(blocks)
        start = first.first_index + self.offset
        samples = bridged(chain([first], blocks))
        return excerpt(samples, start, start + self.span, self.omitted)


@dataclass(frozen=True)
class RecordedWindow:
    """A window in a bag, usable or refused; its telemetry remains in the bag."""

    number: int
    """Running number, from 0."""
    description: ActuatorDescription
    """Description of the actuator at the time of the window."""
    start_ns: int
    """Stamp of the first sample [ns]."""
    end_ns: int
    """Stamp of the last sample [ns]."""
    play: float | None
    """Position of the motor within its backlash at the start [half-widths]; None if unknown."""
    place: WindowPlace | Refusal
    """Position of the samples in the bag, or the refusal of the window."""
    measured: tuple[CauseEstimate, ...] = ()
    """Measured hidden causes."""
    is_remainder: bool = False
    """Whether the record continues the motion of the previous record (see `Window`)."""

    @property
    def window(self) -> Window | Refusal:
        """The window, read from the bag at each access, or its refusal."""
        if isinstance(self.place, Refusal):
            return self.place
        return Window(
            self.place.read(), self.play, self.measured, self.is_remainder, self.place.omitted
        )


@dataclass(frozen=True)
class BagWindows:
    """Content of a bag for one actuator."""

    description: ActuatorDescription
    """Last description of the actuator."""
    first_ns: int
    """Stamp of the first sample [ns]."""
    sample_period: float
    """Period of the samples in the first block [s]."""
    blocks: int
    """Number of blocks of telemetry."""
    samples: int
    """Number of samples."""
    windows: list[RecordedWindow]
    """Usable and refused windows, in order of time."""
    remarks: list[str]
    """Defects of the bag, and of its telemetry outside of windows."""
    longest_motion_s: float
    """Longest motion that gave no window [s], of the command or, for records, of the position."""
    has_rested: bool
    """Whether the command (for records, the position) was ever at rest."""
    obstacle: Reason | None
    """Reason why no window was complete; None if a window was, or if the reason is unknown."""
    truths: list[StampedFaults]
    """True faults of the actuator by test cycle, in order, if the bag records them."""
    flown: "dict[UnitKey, list[tuple[int, FlownDuty]]]" = field(default_factory=dict)
    """Flown duty in pieces, keyed by unit: the stamp of a piece's end [ns], which is the end of a
    window or of the bag, and the duty since the previous piece. Empty if the duty was not
    measured."""

    @property
    def usable(self) -> Sequence[Window]:
        """Usable windows; each is read from the recording when it is accessed."""
        return WindowsOnDemand(self.windows)

    @property
    def kind(self) -> str:
        """Noun for a window: "record" if the drive is unknown, else "window"."""
        return "window" if self.description.is_modelled else "record"

    @property
    def simulated_faults(self) -> bool:
        """Whether the bag records that the actuator was simulated with faults."""
        healthy = healthy_faults()
        return any(not np.array_equal(truth.faults, healthy) for truth in self.truths)

    def __str__(self) -> str:
        unit = self.description
        lines = [
            f"{unit.actuator_id} ({unit.serial_number}), "
            f"{self.samples * self.sample_period:.3f} s of telemetry, "
            f"{counted(len(self.windows), self.kind)}"
        ]
        for item in self.windows:
            state = item.place.reason if isinstance(item.place, Refusal) else "usable"
            start, end = self.seconds(item.start_ns), self.seconds(item.end_ns)
            lines.append(f"{item.number:4d}  {start:.4f} s to {end:.4f} s: {state}")
        return "\n".join([*lines, *self.remarks])

    def seconds(self, stamp_ns: int) -> float:
        """Return a stamp in seconds since the first sample."""
        return (stamp_ns - self.first_ns) * 1e-9

    def true_faults(self, start_ns: int) -> NDArray[np.float64] | None:
        """Return the true faults of the window at a start stamp [ns], ``(8,)``; None if unknown."""
        truth = truth_at(self.truths, start_ns)
        return None if truth is None else truth.faults


class WindowsOnDemand(Sequence[Window]):
    """Usable windows that are read from their recording when they are accessed.

    The 64 most recently accessed windows remain in memory. If the windows are long, fewer do: as
    many as fit into 2 million samples, but at least one.

    Parameters
    ----------
    windows
        Windows of one or several recordings; refused windows are left out.
    """

    def __init__(self, windows: Sequence[RecordedWindow]) -> None:
        self._places = [item for item in windows if isinstance(item.place, WindowPlace)]
        lengths = [item.place.samples for item in windows if isinstance(item.place, WindowPlace)]
        kept = max(1, min(_KEPT_WINDOWS, _KEPT_SAMPLES // max(lengths, default=1)))
        self._read = lru_cache(kept)(lambda number: self._places[number].window)

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, number: Any) -> Any:
        if isinstance(number, slice):
            return WindowsOnDemand(self._places[number])
        return self._read(range(len(self))[number])


def truth_at(truths: Sequence[StampedFaults], start_ns: int) -> StampedFaults | None:
    """Return the true faults of the test cycle at a stamp [ns]; None before the first cycle."""
    before = bisect_right(truths, start_ns, key=lambda truth: truth.stamp_ns)
    return truths[before - 1] if before else None
