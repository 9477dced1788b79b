#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Check that ``colcon test`` has run tests of each package (`make colcon-test`).

``colcon test-result`` also reports success if a package has no result at all. This tool reads the
output of ``colcon test-result --all`` on standard input. It fails if a package is missing, or has
only results of 0 tests.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]


def packages() -> list[str]:
    """Return the names of all packages."""
    folders = ("ema_*", "ros2_ws/src/ema_*")
    manifests = [path for folder in folders for path in ROOT.glob(f"{folder}/package.xml")]
    return sorted(path.parent.name for path in manifests)


def without_tests(names: Iterable[str], lines: Iterable[str]) -> list[str]:
    """Return the packages without a test in the result lines "build/PACKAGE/FILE: N tests, ...".

    The results of CTest, in ``Testing``, are ignored: they count the call of pytest as a test.
    """
    tests: Counter[str] = Counter()
    for line in lines:
        if result := re.match(r"build/(\w+)/(?!Testing/).*: (\d+) tests?,", line):
            tests[result[1]] += int(result[2])
    return [name for name in names if not tests[name]]


def main() -> None:
    """Read results on standard input. Exit with a message if a package has no test."""
    names = packages()
    if missing := without_tests(names, sys.stdin):
        sys.exit(
            f"colcon test has run no test of {', '.join(missing)}: each of the {len(names)} "
            "packages needs at least one; see ros2_ws/log/latest_test"
        )


if __name__ == "__main__":
    main()
