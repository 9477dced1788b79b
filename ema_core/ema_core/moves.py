# SPDX-License-Identifier: Apache-2.0
"""Figures (scalar measurements) of moves, for drives that do not log samples."""

from collections.abc import Mapping
from typing import NamedTuple


class Move(NamedTuple):
    """Figures of one move, or their medians over several equal moves."""

    stamp_ns: int
    """Timestamp of the first move [ns]."""
    figures: Mapping[str, float]
    """Figures by name; all positive."""
