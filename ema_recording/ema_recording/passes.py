"""A bag from its beginning to its end, once or again and again."""

import threading
from collections.abc import Callable
from typing import Final

from ema_core.wording import counted
from ema_recording.playback import Playback
from ema_recording.played_bag import PlayedBag
from ema_recording.player_outputs import PlayerOutputs
from ema_recording.player_settings import PlayerSettings

_BETWEEN_S: Final = 0.05


class Passes:
    """Plays a bag in the thread that calls it.

    Parameters
    ----------
    tell, warn
        Called with what is done, and with what is not as it should be.
    on_jump
        Called when it has gone back to the beginning.

    Attributes
    ----------
    number
        The number of the pass, from 1.
    playback
        What is played, and how far.
    """

    def __init__(
        self,
        played: PlayedBag,
        outputs: PlayerOutputs,
        settings: PlayerSettings,
        tell: Callable[[str], None],
        warn: Callable[[str], None],
        on_jump: Callable[[], None],
    ) -> None:
        self._played = played
        self._outputs = outputs
        self._settings = settings
        self._tell = tell
        self._warn = warn
        self._on_jump = on_jump
        self._is_begun = False
        self.number = 1
        self.playback = Playback(
            played.messages(played.start_ns),
            settings.rate,
            1.0 / settings.clock_rate_hz,
            outputs.publish,
            outputs.publish_clock,
        )

    def begin(self) -> None:
        """Publish what is latched before the first message that is played, once."""
        if not self._is_begun and self._settings.start_offset:
            self._outputs.publish_latched(self._played.latched_before(self._played.start_ns))
        self._is_begun = True

    def skip_begin(self) -> None:
        """Go on elsewhere than at the beginning."""
        self._is_begun = True

    def run(self, stop: threading.Event) -> bool:
        """Play on, the first time once there are subscribers.

        Returns
        -------
        bool
            Whether the end is reached, and all that was played has arrived.
        """
        if not self._is_begun:
            self._wait_for_subscribers(stop)
        if stop.is_set():
            return False
        self.begin()
        while True:
            self._tell(f"playing at rate {self.playback.rate:g}")
            if not self.playback.run(stop):
                self._tell(f"paused after {counted(self.playback.played, 'message')}")
                return False
            played = counted(self.playback.played, "message")
            if pending := self._outputs.await_acknowledgement(stop):
                self._warn(f"not all messages on {', '.join(pending)} are acknowledged")
            # A bag without duration would be begun again at once.
            if stop.is_set() or (self._settings.loop and stop.wait(_BETWEEN_S)):
                return False
            self._tell(f"played {played} of {self._played.bag.path}")
            if not self._settings.loop:
                return True
            self._begin_again()

    def _begin_again(self) -> None:
        """Go back to the beginning, as by a seek."""
        start_ns = self._played.start_ns
        self.number += 1
        self.playback.go_to(start_ns, self._played.messages(start_ns))
        self._on_jump()
        self._outputs.publish_latched(self._played.latched_before(start_ns))

    def _wait_for_subscribers(self, stop: threading.Event) -> None:
        """Wait for subscriptions, at most as long as the settings say."""
        wait_s = self._settings.wait_s
        if wait_s and (missing := self._outputs.missing()):
            self._tell(f"waiting for a subscriber of {missing}")
        self._outputs.await_subscribers(stop, wait_s)
        if not stop.is_set() and (missing := self._outputs.missing()):
            self._warn(f"no subscriber of {missing} after {wait_s:g} s: starting")
        for words in self._outputs.live_monitors():
            self._warn(words)
