"""Identification in a thread of its own: windows in, estimates out in the same order."""

import threading
import traceback
from collections.abc import Callable

from ema_core.description import ActuatorDescription
from ema_monitor.calibration import Calibration
from ema_monitor.diagnosis import Diagnosis, Search
from ema_monitor.estimate import Estimate
from ema_monitor.last_faults import LastFaults
from ema_monitor.model import compile_kernels
from ema_monitor.trigger import Refusal
from ema_monitor.waiting_room import WaitingRoom
from ema_monitor.watch import Found

_PATIENCE_S = 1.0


class IdentificationThread:
    """Identifies windows one after the other; every window gets an estimate, be it a refusal.

    Parameters
    ----------
    calibration_of
        Gives the calibration of an actuator, or why there is none.
    search
        Gives how to identify; asked for each window.
    last_faults
        Where searches begin.
    conclude
        Called with each window and its estimate.
    report_failure
        Called with the traceback when a window cannot be dealt with.
    """

    def __init__(
        self,
        calibration_of: Callable[[ActuatorDescription], Calibration | str],
        search: Callable[[], Search],
        last_faults: LastFaults,
        conclude: Callable[[Found, Estimate], None],
        report_failure: Callable[[str], object],
    ) -> None:
        self._calibration_of = calibration_of
        self._search = search
        self._last_faults = last_faults
        self._conclude = conclude
        self._report_failure = report_failure
        self._room = WaitingRoom(None)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._work, name="identification", daemon=True)

    @property
    def is_running(self) -> bool:
        """Whether it was started and has not been stopped."""
        return self._thread.ident is not None and not self._stopped.is_set()

    @property
    def waiting(self) -> int:
        """How many windows wait."""
        return len(self._room)

    @property
    def dropped(self) -> int:
        """How many windows had to give way to later ones."""
        return self._room.dropped

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    def put(self, found: Found, most_waiting: int | None) -> list[Found]:
        """Let a window, or a refusal, wait for its turn.

        Parameters
        ----------
        found
            What was found.
        most_waiting
            How many windows of an actuator may wait; None for any number.

        Returns
        -------
        list of Found
            The windows that had to give way.
        """
        self._room.limit(most_waiting)
        return self._room.put(found)

    def stop(self) -> None:
        """Stop, in the middle of a window if need be, and refuse the windows that wait."""
        self._stopped.set()
        left = self._room.close()
        # A compilation cannot be broken off; the thread ends by itself when it is done.
        self._thread.join(_PATIENCE_S)
        for found in left:
            self.refuse(found, "the monitor was stopped before the window was identified")

    def refuse(self, found: Found, reason: str) -> None:
        """Conclude a window without identification.

        Parameters
        ----------
        found
            The window, or its refusal.
        reason
            Why; that of the refusal when empty.
        """
        window = found.window
        refused = Refusal(window.start_ns, window.end_ns, reason) if reason else window
        run = self._diagnosis(Found(found.number, found.description, refused))
        for _ in run:
            pass
        self._finish(found, run)

    def _work(self) -> None:
        compile_kernels()
        while (found := self._room.get()) is not None:
            try:
                self._identify(found)
            except Exception as error:
                # One window that cannot be dealt with must not end the work on the others.
                self._give_up(found, error)

    def _identify(self, found: Found) -> None:
        run = self._diagnosis(found)
        try:
            for _ in run:
                if self._stopped.is_set():
                    self.refuse(found, "the monitor was stopped during the identification")
                    return
        except ValueError as error:
            self.refuse(found, str(error))
            return
        self._finish(found, run)

    def _give_up(self, found: Found, error: Exception) -> None:
        reason = f"the identification failed: {error!r}"
        self._report_failure(f"window {found.number}: {reason}\n{traceback.format_exc()}")
        try:
            self.refuse(found, reason)
        except Exception:
            self._report_failure(
                f"window {found.number} cannot be refused either:\n{traceback.format_exc()}"
            )

    def _diagnosis(self, found: Found) -> Diagnosis:
        calibration = self._calibration_of(found.description)
        return Diagnosis(found, calibration, self._search(), last_faults=self._last_faults)

    def _finish(self, found: Found, run: Diagnosis) -> None:
        if run.estimate is None:
            raise RuntimeError("the diagnosis ended without an estimate")
        self._conclude(found, run.estimate)
