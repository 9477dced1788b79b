# SPDX-License-Identifier: Apache-2.0
"""Extraction of stretches, which are windows from ordinary motion without a test cycle (M28)."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from ema_core.parameters import ActuatorParameters
from ema_core.telemetry import Telemetry, join
from ema_monitor.reasons import Reason
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
"""Longest wait in motion for a start with a known position of the motor in its play [s]."""

_EVERY_S: Final = 1e-3
_REACH_S: Final = 1.0
# Only the motor moves the shaft behind the play. 0.1 mrad is far above the resolution and noise of
# a position sensor; play below this travel is negligible.
_CONTACT: Final = 1e-4
_TURNED_BACK: Final = 2e-6
_LATEST_S: Final = 0.01


class StretchTrigger(WindowTrigger):
    """Extracts stretches from continuous telemetry while the command moves.

    A stretch begins at a sample in motion, or at the last sample at rest, and has the length of a
    window. Stretches do not overlap. Preferably, a stretch begins where the position of the motor
    in its play is known: the motor has turned in one direction, and the shaft behind the play has
    followed. After ``WAIT_S`` of motion without such a sample, a stretch begins with an unknown
    position in the play. Stretches with too little travel are skipped.

    Parameters and attributes are as in `WindowTrigger`.
    """

    def __init__(
        self, parameters: ActuatorParameters, settings: TriggerSettings | None = None
    ) -> None:
        self._tau = parameters.tau
        super().__init__(parameters, settings)

    def reset(self) -> None:
        """Discard the telemetry so far; the counts remain."""
        super().reset()
        self._candidate: int | None = None
        self._waited = 0
        self._play: float | None = None

    def interrupt(self, stamp_ns: int, cause: Reason) -> Refusal | Defect:
        """Drop the buffered blocks, and return a defect.

        An incomplete stretch is not reported as lost.
        """
        self._start = None
        return super().interrupt(stamp_ns, cause)

    def finish(self) -> Sequence[Window | Refusal]:
        """Return an empty list: an incomplete stretch is not reported as lost."""
        return []

    def _scan(self, block: Telemetry) -> list[Window | Refusal | Defect]:
        """Process the commands of a block; return the stretches and refusals that it completes."""
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
                # The last sample at rest if there is one, otherwise this sample.
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
        """Return the position of the motor in its play at a sample, or None if it is unknown.

        Motor and shaft are in contact if both have last moved in the same direction. Without a
        measured speed, they are in contact while the shaft moves, because only the motor moves the
        shaft.
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
