"""Levels of a status or of health, as diagnostic_msgs/DiagnosticStatus numbers them."""

from typing import Final

OK: Final = 0
WARN: Final = 1
ERROR: Final = 2
STALE: Final = 3

LEVEL_NAMES: Final = ("OK", "WARN", "ERROR", "STALE")
