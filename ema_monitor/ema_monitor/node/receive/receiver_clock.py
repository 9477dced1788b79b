# SPDX-License-Identifier: Apache-2.0
"""Stamp clock and monotonic clock of a node, with detection of backward steps."""

import contextlib
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from ema_core.files import complete_file
from ema_monitor.node.moment import Moment

_LEAST_STEP_NS: Final = 1_000_000_000
"""Smallest backward step of the clock that is detected [ns]; adjustments by NTP are slower."""

_KEPT_TO_NS: Final = 100_000_000
"""Smallest change of the clock offset that is written to the file [ns]."""

_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")


def boot_id() -> str:
    """Return the identifier of the current boot of the machine; empty if unavailable."""
    try:
        return _BOOT_ID.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def boot_time_ns() -> int:
    """Return the time since the machine booted [ns], including suspend time."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


class ReceiverClock:
    """Reads the clock of a node and a steady clock, and detects backward steps.

    In simulated time the steady clock is the simulated clock without its backward steps.

    Parameters
    ----------
    read_ns
        Returns the stamp-clock time [ns].
    is_simulated
        Whether the stamp clock is simulated time.
    steady_ns
        Returns the time of a steady clock [ns] that keeps running while the node is stopped.
    kept
        File that stores the clock offset for the next run of the node, or None.
    boot_id
        Returns the identifier of the current boot, for which the offset is valid.
    """

    def __init__(
        self,
        read_ns: Callable[[], int],
        *,
        is_simulated: bool = False,
        steady_ns: Callable[[], int] = boot_time_ns,
        kept: Path | None = None,
        boot_id: Callable[[], str] = boot_id,
    ) -> None:
        self._read_ns, self._steady_ns = read_ns, steady_ns
        self.is_simulated = is_simulated
        self._passed_ns = 0
        self._kept, self._boot_id = (None if is_simulated else kept), boot_id()
        self._offset_ns = self._kept_ns = self._read_kept()
        self._is_continued = self._offset_ns is not None

    @property
    def passed_ns(self) -> int:
        """Latest stamp-clock time before the clock stepped back [ns]; 0 without a step."""
        return self._passed_ns

    def read(self) -> tuple[Moment, int]:
        """Return the time, and the backward clock step since the previous call [ns].

        The step is 0 if it is shorter than 1 s.
        """
        clock_ns = self._read_ns()
        if self.is_simulated:
            return self._read_simulated(clock_ns)
        steady_ns = self._steady_ns()
        offset_ns = clock_ns - steady_ns
        before_ns = offset_ns if self._offset_ns is None else self._offset_ns
        self._offset_ns = offset_ns
        back_ns = before_ns - offset_ns
        if back_ns >= _LEAST_STEP_NS:
            self._passed_ns = max(self._passed_ns, clock_ns + back_ns)
        self._keep(offset_ns)
        moment = Moment(clock_ns, steady_ns, self._passed_ns, self._is_continued)
        return moment, back_ns if back_ns >= _LEAST_STEP_NS else 0

    def _read_kept(self) -> int | None:
        """Return the clock offset from an earlier run since the machine started [ns], or None.

        ``passed_ns`` is restored as well.
        """
        if self._kept is None or not self._boot_id:
            return None
        with contextlib.suppress(OSError, ValueError, TypeError, KeyError):
            record = json.loads(self._kept.read_text(encoding="utf-8"))
            if record["boot_id"] == self._boot_id:
                self._passed_ns = int(record.get("passed_ns", 0))
                return int(record["offset_ns"])
        return None

    def _keep(self, offset_ns: int) -> None:
        """Write the offset for the next run if it has changed."""
        if self._kept is None:
            return
        if self._kept_ns is not None and abs(offset_ns - self._kept_ns) < _KEPT_TO_NS:
            return
        self._kept_ns = offset_ns
        # If this fails, the next run restores no level from its histories.
        with contextlib.suppress(OSError):
            self._kept.parent.mkdir(parents=True, exist_ok=True)
            with complete_file(self._kept) as partial:
                record = {"boot_id": self._boot_id, "offset_ns": offset_ns}
                kept = json.dumps(record | {"passed_ns": self._passed_ns})
                partial.write_text(kept, encoding="utf-8")

    def _read_simulated(self, clock_ns: int) -> tuple[Moment, int]:
        # The latest time, and the sum of the backward steps as the offset.
        before_ns, offset_ns = self._simulated
        back_ns = max(before_ns - clock_ns, 0)
        self._simulated = clock_ns, offset_ns + back_ns
        steady_ns = clock_ns + self._simulated[1] if clock_ns or self._simulated[1] else 0
        moment = Moment(clock_ns, steady_ns, is_real=False)
        return moment, back_ns if back_ns >= _LEAST_STEP_NS else 0

    _simulated: tuple[int, int] = 0, 0
