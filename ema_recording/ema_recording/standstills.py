"""Times in which a recorder did not get on.

It was stopped or starved, the machine was asleep, or a call that writes took long.
"""

from typing import Final

from ema_recording.gaps import Gap

LEAST_S: Final = 2.0
"""How late a call has to be to be told [s]."""


class Standstills:
    """Notices, by calls that come regularly, when they did not come.

    What is published meanwhile may be lost without a trace: a publisher keeps no more than its
    history has room for, and nothing for a subscriber that it takes for gone.

    Attributes
    ----------
    count
        How many there were.
    total_s
        How long they were together [s].
    """

    def __init__(self) -> None:
        self.count = 0
        self.total_s = 0.0
        self._last: tuple[float, int] | None = None

    def call(self, now_s: float, log_time_ns: int) -> Gap | None:
        """Note a call; return the time before it in which the process stood still.

        Parameters
        ----------
        now_s
            Of a clock that is never set and goes on while the machine is asleep [s].
        log_time_ns
            Log time of messages that come now [ns].
        """
        last, self._last = self._last, (now_s, log_time_ns)
        if last is None or now_s - last[0] < LEAST_S:
            return None
        stood_s = now_s - last[0]
        self.count += 1
        self.total_s += stood_s
        # Simulated time may have gone back meanwhile.
        start_ns, end_ns = sorted((last[1], log_time_ns))
        return Gap(f"the recorder stood still for {stood_s:.1f} s", start_ns, end_ns)

    def pause(self) -> None:
        """Expect no call until the next one."""
        self._last = None
