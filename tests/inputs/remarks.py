# SPDX-License-Identifier: Apache-2.0
"""Doubts of a recognised mapping as text."""

from ema_bags.inputs.doubt_wording import doubt_text
from ema_bags.inputs.guess import Guess


def remarks_of(guess: Guess) -> list[str]:
    return [doubt_text(doubt) for doubt in guess.doubts]
