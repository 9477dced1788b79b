# SPDX-License-Identifier: Apache-2.0
"""Units that are failed, unknown, mixed up or silent must not be reported as OK."""

import json
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import pytest

from ema_archive.query import answer
from ema_bags.writer import BagWriter
from ema_core.description import ActuatorDescription
from ema_core.levels import ERROR, OK
from ema_core.telemetry import Telemetry
from ema_monitor.prognosis.history_entry import StampedTest, unordered
from ema_ros import topics
from ema_ros.actuator_messages import messages_of_block
from ema_ros.messages import description_to_message
from ema_sim import simulate

from ..commands import ema

FLAP = ActuatorDescription()
DAY_S = 86_400.0


def telemetry(faults: dict[str, float], day: float, **options: Any) -> Telemetry:
    recorded = simulate(faults, current_noise=0.02, **options)
    return replace(recorded, stamp_ns=recorded.stamp_ns + round((1e9 + DAY_S * day) * 1e9))


def write(path: Path, *parts: tuple[ActuatorDescription, Telemetry]) -> None:
    """Write a bag with the telemetry of one or several units, one after the other."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with BagWriter(path) as writer:
        for name, (message_class, qos) in topics.ACTUATOR_TOPICS.items():
            writer.add_topic(f"{topics.NAMESPACE}/{name}", message_class, qos)
        for number, (unit, block) in enumerate(parts):
            logged_ns = block.stamp_ns + number * 10**10
            described = {topics.DESCRIPTION: description_to_message(unit, block.stamp_ns)}
            for name, message in (described | messages_of_block(unit, block, 0.0)).items():
                writer.write(f"{topics.NAMESPACE}/{name}", message, logged_ns, logged_ns)


def archived(bags: Path) -> Path:
    folder = bags.parent / "archive"
    assert ema("archive", "scan", folder, bags).exit_code == 0
    ema("archive", "run", folder, "--workers", "1")
    return folder


def asked(archive: Path, question: str) -> list[dict[str, Any]]:
    names, rows = answer(archive, question)
    return [dict(zip(names, row, strict=True)) for row in rows]


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of bags with three healthy tests, then two tests with an open phase."""
    folder = tmp_path_factory.mktemp("opened") / "bags"
    for day in range(5):
        causes = {"open_phase_a": 1.0} if day > 2 else ()
        write(folder / f"{day}.mcap", (FLAP, telemetry({}, day, seed=day, causes=causes)))
    return folder


@pytest.mark.slow
def test_failure_after_healthy_tests_sets_the_level(opened: Path):
    reported = ema("predict", opened, "--json", "--hours-per-cycle", "10")
    assert reported.exit_code == 3
    health = json.loads(reported.stdout)
    assert (health["level"], health["health_index"], health["rul"]["known"]) == (ERROR, 0.0, False)
    assert "open phase A" in health["cause"]
    assert health["removal"].startswith("Remove now: dead switch or open phase A")
    assert [test["level"] for test in health["tests"]] == [OK, OK, OK, ERROR, ERROR]
    page = opened.parent / "report.html"
    assert ema("report", opened, "-o", page).exit_code == 3
    assert "Failed: dead switch or open phase A" in page.read_text()
    assert "Well" not in page.read_text()
    archive = archived(opened)
    [row] = asked(archive, "select * from worst_first")
    assert row["health"] == "ERROR"
    [alarm] = asked(archive, "select * from alarms")
    assert (alarm["level"], alarm["tests"]) == (ERROR, 2)


@pytest.mark.slow
def test_window_belongs_to_the_unit_described_at_its_time(tmp_path: Path):
    old_unit = replace(FLAP, serial_number="OLD-A")
    faults = {"friction": 0.45, "short_circuit_a": 0.4}
    write(
        tmp_path / "bags" / "mixed.mcap",
        (FLAP, telemetry(faults, 0.0)),
        (old_unit, telemetry({}, 1.0)),
    )
    rows = asked(archived(tmp_path / "bags"), "select serial_number, friction from estimates")
    friction = {row["serial_number"]: row["friction"] for row in rows}
    assert friction[FLAP.serial_number] == pytest.approx(0.45, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("tests_of_bag", "cause"), [(1, ""), (2, ""), (2, "open_phase_a")])
def test_different_tests_that_end_at_the_same_time_are_not_copies(
    tmp_path: Path, tests_of_bag: int, cause: str
):
    worn = telemetry({"friction": 0.45}, 0.0, causes={cause: 1.0} if cause else ())
    tests = [(FLAP, telemetry({}, 0.0)), (FLAP, worn)]
    for first in range(0, 2, tests_of_bag):
        write(tmp_path / "bags" / f"{first}.mcap", *tests[first : first + tests_of_bag])
    archive = archived(tmp_path / "bags")
    [row] = asked(archive, "select health, reason from worst_first")
    words = "open phase A" if cause else "their stamps must show which came first"
    assert (row["health"], words in row["reason"]) == ("ERROR" if cause else "STALE", True)
    assert len(asked(archive, "select * from unordered")) == (1 if cause else 2)
    assert asked(archive, "select * from copies") == []


@pytest.mark.parametrize("order", list(permutations([("a", 0), ("copy of a", 0), ("c", 1)])))
def test_copies_of_a_test_do_not_hide_another_test_at_the_same_time(
    order: tuple[tuple[str, int], ...],
):
    tests = [StampedTest(0, 10, bag, content) for bag, content in order]
    assert set(unordered(tests)) == {"a", "copy of a", "c"}


def test_tests_that_overlap_in_time_are_reported_as_unordered():
    times = {"a": (5, 10), "b": (20, 30), "c": (0, 100)}
    assert set(unordered([StampedTest(*times[bag], bag, bag) for bag in times])) == set(times)


@pytest.mark.slow
def test_units_without_a_valid_test_are_counted(tmp_path: Path):
    for number in range(3):
        unit = replace(FLAP, serial_number=f"OTHER-{number}" if number else FLAP.serial_number)
        write(tmp_path / "bags" / f"{number}.mcap", (unit, telemetry({}, number)))
    archive = archived(tmp_path / "bags")
    rows = asked(archive, "select serial_number, health from worst_first")
    assert [row["health"] for row in rows] == ["STALE", "STALE", "OK"]
    page = archive.parent / "fleet.html"
    assert ema("report", "--fleet", archive, "-o", page).exit_code == 0
    assert "3 units" in page.read_text()


@pytest.mark.slow
def test_info_reports_all_units_of_a_damaged_bag(tmp_path: Path):
    path = tmp_path / "fleet.mcap"
    units = [replace(FLAP, actuator_id=name) for name in ("left", "right")]
    write(path, *((unit, telemetry({}, 0.0)) for unit in units))
    path.write_bytes(path.read_bytes()[:-60])
    reported = ema("info", path)
    assert reported.exit_code == 0
    for expected in ("actuator left,", "actuator right,", "warning: "):
        assert expected in reported.stdout
    assert "actuator right," not in ema("info", path, "--actuator-id", "left").stdout
