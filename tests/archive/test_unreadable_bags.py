# SPDX-License-Identifier: Apache-2.0
"""Unreadable bags: no unit is OK whose newest test may be lost."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ema_archive.bag_task import DAMAGED, DONE, FAILED, BagResult, BagTask, UnitRows, diagnose_bag
from ema_archive.fleet import fleet_summary
from ema_archive.manifest import Manifest, Status
from ema_archive.query import answer
from ema_archive.running import run, scan
from ema_archive.tables import estimate_row
from ema_core.description import ActuatorDescription
from ema_core.tasks import Workers
from ema_monitor.calibration.calibration import Calibration

from ..prognosis.made_tests import made_test

HERE = ("--executor", "threads", "--workers", "1")
LEVELS = "select serial_number, health, reason from worst_first order by 1"


def keep_bytes(count: int) -> Callable[[Path], None]:
    def cut(path: Path) -> None:
        path.write_bytes(path.read_bytes()[:count])

    return cut


def write_text(path: Path) -> None:
    path.write_text("no bag\n" * 1000, encoding="utf-8")


@pytest.fixture
def worsening(made_fleet: Path, tmp_path: Path) -> Path:
    """Return a folder with two bags of a unit: 9.mcap gives OK, the later 8.mcap gives WARN."""
    folder = tmp_path / "bags" / "unit_0"
    folder.mkdir(parents=True)
    for name in ("calibration.yaml", "9.mcap", "8.mcap"):
        shutil.copy(made_fleet / "unit_0" / name, folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    "damage", [keep_bytes(60_000), keep_bytes(3000), keep_bytes(0), write_text]
)
def test_unit_whose_newest_bag_cannot_be_read_is_not_ok(
    ema, worsening: Path, tmp_path: Path, damage: Callable[[Path], None]
):
    archive, page, newest = tmp_path / "archive", tmp_path / "fleet.html", worsening / "8.mcap"
    content = newest.read_bytes()
    damage(newest)
    ema("archive", "scan", archive, worsening.parent)
    for done in (1, 0):
        result = ema("archive", "run", archive, *HERE)
        assert result.exit_code == 3, result.output
        assert f"{2 * done} bags and {done} unit" in result.stdout
        assert "1 bag cannot be read" in result.stdout
        status = ema("archive", "status", archive)
        assert "1 bag cannot be read" in status.stdout
        _, [(_, level, reason)] = answer(archive, LEVELS)
        assert (level, reason[:24]) == ("STALE", "later tests may be lost:")
        assert str(newest) in reason
    assert ema("report", "--fleet", archive, "-o", page).exit_code == 0
    assert f"Of 2 bags: 1 cannot be read. Unreadable: {newest}" in page.read_text()
    newest.write_bytes(content)
    ema("archive", "scan", archive)
    assert ema("archive", "run", archive, *HERE).exit_code == 0
    _, [(_, level, reason)] = answer(archive, LEVELS)
    assert (level, "lost" in reason) == ("WARN", False)


def drawn(task: BagTask) -> BagResult:
    """Return the drawn test of a bag, whose text is serial number and day, or a state."""
    words = Path(task.url).read_text(encoding="utf-8").split()
    if words[0] in (DAMAGED, FAILED):
        return BagResult(task, words[0], "it has no telemetry", end_ns=int(words[1]))
    friction = 0.6 if "worn" in words else 0.02
    estimate = made_test(int(words[1]), seed=1, friction=friction)
    unit = {"actuator_id": "flap", "serial_number": words[0]}
    made = {"bag": task.url, "bag_sha256": task.mark, "software": "", "settings": ""}
    rows = UnitRows(
        "flap", words[0], "drawn", "", [estimate_row(estimate, 0) | unit | made], [], []
    )
    return BagResult(task, DONE, sha256=task.mark, units=[rows], end_ns=estimate.end_ns)


class Drawn:
    """An archive of drawn tests, whose bags are text files."""

    def __init__(self, folder: Path) -> None:
        self.bags, self.archive = folder / "bags", folder / "archive"
        self.bags.mkdir()

    def write(self, name: str, words: str) -> Path:
        path = self.bags / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(words, encoding="utf-8")
        return path

    def update(self) -> dict[str, tuple[Any, ...]]:
        """Scan and run; return level and reason by unit."""
        with Manifest(self.archive, is_new=True) as manifest, Workers("threads", 1) as pool:
            scan(manifest, [str(self.bags)])
            run(manifest, pool, diagnose=drawn)
        return {row[0]: row[1:] for row in answer(self.archive, LEVELS)[1]}

    def status(self) -> Status:
        with Manifest(self.archive, writes=False) as manifest:
            return manifest.status(manifest.settings)


@pytest.fixture
def fleet_of_drawn(tmp_path: Path) -> Drawn:
    """Return an archive of two units in separate folders, with three healthy tests each."""
    made = Drawn(tmp_path)
    for serial in ("A", "B"):
        for day in range(3):
            made.write(f"unit {serial}/{day}.mcap", f"{serial} {day}")
    assert {unit: level for unit, (level, _) in made.update().items()} == {"A": "OK", "B": "OK"}
    return made


@pytest.mark.parametrize("state", [DAMAGED, FAILED])
def test_unreadable_bag_makes_the_units_of_its_folder_stale(fleet_of_drawn: Drawn, state: str):
    bag = fleet_of_drawn.write("unit A/3.mcap", f"{state} 0")
    units = fleet_of_drawn.update()
    what = "cannot be read" if state == DAMAGED else "could not be read"
    words = f"later tests may be lost: {bag} {what}: it has no telemetry"
    assert units["A"][0] == "STALE"
    assert units["A"][1].startswith(words)
    assert units["B"][0] == "OK"
    assert fleet_of_drawn.status().of_no_unit == []
    # A repeated update gives the same levels until the bag is removed.
    assert fleet_of_drawn.update() == units
    bag.unlink()
    assert fleet_of_drawn.update()["A"][0] == "OK"
    status = fleet_of_drawn.status()
    assert (status.damaged, status.failed, status.gone) == (0, 0, 1)


def test_alarm_remains_next_to_an_unreadable_bag(fleet_of_drawn: Drawn):
    for day in (3, 4, 5):
        fleet_of_drawn.write(f"unit A/{day}.mcap", f"A {day} worn")
    level, _ = fleet_of_drawn.update()["A"]
    assert level in ("WARN", "ERROR")
    fleet_of_drawn.write("unit A/6.mcap", "damaged 0")
    after, reason = fleet_of_drawn.update()["A"]
    assert (after, reason[:23]) == (level, "later tests may be lost")


def test_calibration_next_to_an_unreadable_bag_names_its_unit(fleet_of_drawn: Drawn):
    """The folder contains no other bag."""
    bag = fleet_of_drawn.write("new/3.mcap", "damaged 0")
    unit = replace(ActuatorDescription(), actuator_id="flap", serial_number="B")
    builtin = Calibration.builtin()
    calibration = replace(builtin, actuator_id=unit.actuator_id, serial_number="B")
    calibration.save(bag.with_name("calibration.yaml"))
    units = fleet_of_drawn.update()
    assert (units["A"][0], units["B"][0]) == ("OK", "STALE")
    assert str(bag) in units["B"][1]


def test_unreadable_bag_without_a_unit_is_named(ema, fleet_of_drawn: Drawn, tmp_path: Path):
    named = fleet_of_drawn.write("unit A/3.mcap", "damaged 0")
    bag = fleet_of_drawn.write("new/3.mcap", "damaged 0")
    units = fleet_of_drawn.update()
    assert (units["A"][0], units["B"][0]) == ("STALE", "OK")
    words = ema("archive", "status", fleet_of_drawn.archive).stdout
    assert "2 bags cannot be read" in words
    assert f"1 bag without a known unit cannot be read: {bag}\n" in words
    as_json = json.loads(ema("archive", "status", fleet_of_drawn.archive, "--json").stdout)
    assert as_json["of_no_unit"] == [str(bag)]
    _, rows = answer(fleet_of_drawn.archive, "select what, reason, count from refused_why")
    assert rows == [("damaged", "it has no telemetry", 2)]
    assert fleet_summary(fleet_of_drawn.archive).bags["unreadable"] == [str(bag), str(named)]


def test_later_intact_bag_ends_the_doubt_about_a_dated_bag(fleet_of_drawn: Drawn):
    """An unreadable bag without a known time may be the newest, so that the unit stays STALE."""
    last_ns = made_test(2, seed=1).end_ns
    bag = fleet_of_drawn.write("unit A/3.mcap", f"damaged {last_ns + 10**9}")
    assert fleet_of_drawn.update()["A"][0] == "STALE"
    fleet_of_drawn.write("unit A/4.mcap", "A 5")
    assert fleet_of_drawn.update()["A"][0] == "OK"
    bag.write_text("damaged 0 of another content", encoding="utf-8")
    fleet_of_drawn.write("unit A/5.mcap", "damaged 0")
    assert fleet_of_drawn.update()["A"][0] == "STALE"


def test_changed_bag_that_could_not_be_read_makes_its_unit_stale(fleet_of_drawn: Drawn):
    """The rows of the bag are intact, but its newest content is unknown."""
    fleet_of_drawn.write("unit A/2.mcap", "failed 0")
    assert fleet_of_drawn.update()["A"][0] == "STALE"
    fleet_of_drawn.write("unit A/2.mcap", "A 2 again")
    assert fleet_of_drawn.update()["A"][0] == "OK"


@pytest.mark.parametrize("content", [b"", b"no bag" * 1000])
def test_file_that_is_not_a_bag_is_damaged(tmp_path: Path, content: bytes):
    path = tmp_path / "bag.mcap"
    path.write_bytes(content)
    with Manifest(tmp_path / "archive", is_new=True) as manifest:
        task = BagTask(str(path), "", "", manifest.settings)
    assert diagnose_bag(task).state == DAMAGED
