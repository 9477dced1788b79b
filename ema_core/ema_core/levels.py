# SPDX-License-Identifier: Apache-2.0
"""Levels of status and health, numbered as in diagnostic_msgs/DiagnosticStatus."""

from typing import Final

OK: Final = 0
WARN: Final = 1
ERROR: Final = 2
STALE: Final = 3

LEVEL_NAMES: Final = ("OK", "WARN", "ERROR", "STALE")
