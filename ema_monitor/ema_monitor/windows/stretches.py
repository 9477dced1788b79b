"""Stretches of ordinary motion in a stream of telemetry: windows that need no test cycle (M28)."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry, join
from ema_monitor.windows.trigger import (
    LEAST_REST,
    Defect,
    Refusal,
    TriggerSettings,
    WindowTrigger,
    play_after,
)
from ema_monitor.windows.window import MIN_TRAVEL, Window

WAIT_S: Final = 0.1
"""How long a stretch waits, in motion, for a start at which the place in the play is known [s]."""

_EVERY_S: Final = 1e-3
_REACH_S: Final = 1.0
# The shaft behind the play moves with the motor alone. A tenth of a milliradian is far above the
# resolution and noise of a position sensor; the motor's return within it is negligible play.
_CONTACT: Final = 1e-4
_TURNED_BACK: Final = 2e-6
_LATEST_S: Final = 0.01


class StretchTrigger(WindowTrigger):
    """Cuts stretches out of continuous telemetry wherever the command moves.

    A stretch begins at a sample in motion, or the last at rest, and is as long as a window; the
    next one begins at its end at the earliest. One at which the motor's place in its play is known
    is preferred: the motor has turned one way, and the shaft behind the play with it. When there is
    none for ``WAIT_S`` of motion, a stretch begins with an unknown place. There is no stretch at
    rest, and one with too little travel is passed over.

    Other parameters, and attributes, are as in `WindowTrigger`.
    """

    def __init__(
        self, parameters: ActuatorParameters, settings: TriggerSettings | None = None
    ) -> None:
        self._tau = parameters.tau
        super().__init__(parameters, settings)

    def reset(self) -> None:
        """Forget the telemetry so far; the counts remain."""
        super().reset()
        self._candidate: int | None = None
        self._waited = 0
        self._play: float | None = None

    def interrupt(self, stamp_ns: int, reason: str) -> Refusal | Defect:
        """Drop the kept blocks; a stretch that is cut off is not a loss."""
        self._start = None
        return super().interrupt(stamp_ns, reason)

    def finish(self) -> Sequence[Window | Refusal]:
        """Return nothing: a stretch cut off by the end of the telemetry is not a loss."""
        return []

    def _scan(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """Follow the command through a block, sample by sample."""
        h = block.sample_period
        rest_samples = max(LEAST_REST, round(self.settings.rest_s / h))
        window_samples = max(1, round(self.settings.window_s / h))
        every, longest = max(1, round(_EVERY_S / h)), round(WAIT_S / h)
        threshold = self.settings.threshold
        events: list[Window | Refusal | Defect] = []
        for index, command in enumerate(block.command.tolist(), block.first_index):
            was_at_rest = self._rest_count >= rest_samples
            if abs(command - self._rest_value) <= threshold:
                self._rest_count += 1
                self.has_rested |= self._rest_count == rest_samples
            else:
                self._rest_value, self._rest_count = command, 1
            if self._start is not None:
                if index == self._start + window_samples:
                    events += self._complete(self._start, window_samples)
                    self._start, self._candidate = None, index
                continue
            if self._rest_count >= rest_samples:
                self._candidate = None
                continue
            if self._candidate is None:
                # After a rest the last sample of it; else, and at first, this one.
                self._candidate = index - 1 if was_at_rest else index
                self._waited = 0
            elif index < self._candidate + every:
                continue
            else:
                self._candidate = index
                self._waited += every
            self._play = self._play_at(self._candidate)
            if self._play is not None or self._waited >= longest:
                self._start = self._candidate
        return events

    def _complete(self, start: int, samples: int) -> list[Window | Refusal]:
        telemetry, refused = self._cut(start, samples)
        self._waited = 0
        if np.ptp(telemetry.command) < MIN_TRAVEL:
            self.passed_over += 1
            return []
        return [refused or Window(telemetry, self._play)]

    def _play_at(self, index: int) -> float | None:
        """Return the motor's place in its play at a sample, None when it is not known.

        The motor drives the shaft behind its play: where both have moved one way last, they touch.
        Where the speed is not measured, they do so while the shaft moves: it does not by itself.
        """
        h = self._blocks[-1].sample_period
        held = join(self._blocks_from(index - round(_REACH_S / h)))
        stop = index - held.first_index + 1
        reach = slice(max(0, stop - round(_REACH_S / h)), stop)
        position = held.position[reach]
        by_shaft = play_after(position, _CONTACT, _CONTACT / 2.0)
        if not len(held.speed):
            latest = np.ptp(position[-1 - max(1, round(_LATEST_S / h)) :])
            return by_shaft if latest > _CONTACT else None
        turned = self._tau * h * np.cumsum(held.speed[reach])
        by_motor = play_after(turned, _CONTACT, _TURNED_BACK)
        return by_motor if by_motor == by_shaft else None
