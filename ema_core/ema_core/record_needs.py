# SPDX-License-Identifier: Apache-2.0
"""Motion that a record needs to be compared with healthy records."""

from typing import Final

FEWEST_STROKES: Final = 3
"""Minimum number of strokes per direction; a long stroke counts once per ``LONGEST_STROKE_S``."""

FEWEST_REVERSING: Final = 2
"""Minimum number of strokes of any length. Repetition separates effects of position and time."""

LONGEST_STROKE_S: Final = 2.0
"""Duration for which a stroke counts once [s]."""
