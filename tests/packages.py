# SPDX-License-Identifier: Apache-2.0
"""Folders of the packages in the repository."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = {
    path.parent.name: path.parent
    for place in ("ema_*", "ros2_ws/src/*")
    for path in sorted(ROOT.glob(f"{place}/package.xml"))
}
"""Folder of each package by name."""
