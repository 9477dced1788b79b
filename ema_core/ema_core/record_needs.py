# SPDX-License-Identifier: Apache-2.0
"""Motion that a record needs to be compared with healthy records."""

from typing import Final

FEWEST_STROKES: Final = 3
"""Minimum number of strokes per direction, with long strokes counted repeatedly."""

FEWEST_REVERSING: Final = 2
"""Minimum number of strokes per direction, with each stroke counted once. Repetition separates
effects of position from effects of time."""

LONGEST_STROKE_S: Final = 2.0
"""Length up to which a stroke counts once [s]; each further piece of this length counts again."""
