# SPDX-License-Identifier: Apache-2.0
"""Process an archive of randomly drawn tests, one commit per bag; a test kills this program.

python -m tests.archive.drawn_archive ARCHIVE
"""

import sys
from pathlib import Path

from tests.prognosis.made_tests import UNIT, made_test

from ema_archive import running
from ema_archive.bag_task import DONE, BagResult, BagTask, UnitRows
from ema_archive.manifest import Manifest
from ema_archive.sources import content_digest
from ema_archive.tables import count_row, estimate_row
from ema_core.tasks import Workers
from ema_monitor.prognosis.history_entry import Count


def make_stubs(folder: Path, tests: int) -> None:
    """Write one small file per test, which contains the number of the test."""
    folder.mkdir()
    for number in range(tests):
        (folder / f"{number:04d}.mcap").write_text(str(number), encoding="utf-8")


def draw(task: BagTask) -> BagResult:
    """Return a randomly drawn test instead of identifying a bag."""
    number = int(Path(task.url).read_text(encoding="utf-8"))
    estimate = made_test(number, seed=1, friction=0.01 + 0.005 * number)
    names = dict(zip(("actuator_id", "serial_number"), UNIT, strict=True))
    sha256 = content_digest(Path(task.url))
    made = {"bag": task.url, "bag_sha256": sha256, "software": "", "settings": ""}
    count = Count(estimate.start_ns, 20.0 * number, number)
    rows = UnitRows(
        *UNIT,
        "drawn",
        "",
        [estimate_row(estimate, 0) | names | made],
        [count_row(count, 0) | names | {"bag": task.url}],
        [],
    )
    return BagResult(task, DONE, sha256=sha256, units=[rows])


def main(archive: Path) -> None:
    """Process all bags and units of an archive that are due."""
    running._BATCH_S = 0.0
    print("begun", flush=True)
    with Manifest(archive) as manifest, Workers("threads", 1) as pool:
        running.run(manifest, pool, diagnose=draw)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
