# SPDX-License-Identifier: Apache-2.0
"""Where the packages of the repository are: those of the library, and those for ROS alone."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = {
    path.parent.name: path.parent
    for place in ("ema_*", "ros2_ws/src/*")
    for path in sorted(ROOT.glob(f"{place}/package.xml"))
}
"""Folder of each package by its name."""
