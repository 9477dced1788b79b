"""What is known of growth is kept beside the tests: a restart repeats the latest of them alone."""

import math
import sqlite3
from contextlib import closing
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from ema_monitor import unit as unit_module
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.measurement import Measurement
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth.tracker import Tracker
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.unit import Unit

from .lived_units import TEN_HOURS, UNIT, Cycle, drawn_count, follow, plain, worn

N = 8


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "flap.sqlite"


@pytest.fixture(autouse=True)
def kept_each_fourth_test(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(unit_module, "KEPT_EVERY", 4)


@pytest.fixture
def fed(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The hours of the tests that any tracker is updated by from now on."""
    hours: list[float] = []
    update = Tracker.update

    def counting(self: Tracker, measurement: Measurement) -> object:
        hours.append(measurement.hours)
        return update(self, measurement)

    monkeypatch.setattr(Tracker, "update", counting)
    return hours


def lived(path: Path, cycles: list[Cycle], settings: PrognosisSettings = TEN_HOURS) -> list[str]:
    """What is said of each cycle, in a run of its own; all is written after each."""
    unit = Unit(History(*UNIT, path), settings)
    said = []
    for cycle in cycles:
        [outlook] = follow(unit, [cycle], settings)
        unit.write()
        said.append(plain(outlook) if outlook else "")
    unit.history.close()
    return said


def resumed(path: Path, settings: PrognosisSettings = TEN_HOURS) -> str:
    unit = Unit(History(*UNIT, path), settings)
    outlook = unit.resume(None, settings)
    unit.history.close()
    assert (outlook is not None, unit.history.problem) == (True, "")
    return plain(outlook) if outlook else ""


@pytest.mark.slow
@pytest.mark.parametrize("by_cycles", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_restart_from_what_is_kept_says_the_same_to_the_last_bit(
    tmp_path: Path, path: Path, seed: int, by_cycles: bool
):
    """Tests with and without estimate, outliers, counted, not counted, and counted wrongly."""
    rng = np.random.default_rng(seed)
    settings = PrognosisSettings(service=Service(hours_per_cycle=7.0 if by_cycles else 0.0))
    cycles = []
    for number in range(16):
        hours = drawn_count(rng, number)
        cycle = worn(number, math.nan if by_cycles else hours, valid=rng.random() > 0.2)
        if cycle.estimate.valid and rng.random() < 0.2:
            odd = cycle.estimate.faults._replace(friction=0.6)
            cycle = cycle._replace(estimate=replace(cycle.estimate, faults=odd))
        cycles.append(cycle)
    expected = [plain(one) if one else "" for one in follow(Unit(History(*UNIT)), cycles, settings)]
    said = []
    for first in range(0, 16, 3):
        said += lived(path, cycles[first : first + 3], settings)
    assert said == expected


def test_restart_repeats_the_tests_since_the_growth_was_kept_alone(path: Path, fed: list[float]):
    lived(path, [worn(number) for number in range(N + 2)])
    fed.clear()
    resumed(path)
    assert fed == [90.0, 100.0]


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE growth SET state = zeroblob(length(state))",
        "UPDATE growth SET crc32 = crc32 + 1",
        "DELETE FROM growth",
    ],
)
def test_kept_growth_that_is_damaged_is_found_anew_from_the_tests(
    path: Path, fed: list[float], statement: str
):
    lived(path, [worn(number) for number in range(N)])
    expected = resumed(path)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute(statement)
    fed.clear()
    assert resumed(path) == expected
    assert len(fed) == N


def test_kept_growth_of_other_settings_is_not_used(path: Path, fed: list[float]):
    lived(path, [worn(number) for number in range(N)])
    other = replace(TEN_HOURS, tracker=TrackerSettings(process_noise=0.2))
    fed.clear()
    assert resumed(path, other) != resumed(path)
    assert len(fed) == N


@pytest.mark.parametrize("method", [1, 99])
def test_archive_that_cannot_be_unpacked_is_as_none(method: int):
    """Of archives packed in unknown ways, others than numpy raise."""
    stream = BytesIO()
    np.savez(stream, used_hours=np.zeros(1))
    kept = bytearray(stream.getvalue())
    for mark, place in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        kept[kept.index(mark) + place] = method
    record = GrowthRecord(HealthLimits(), TrackerSettings(), [], bytes(kept))
    assert (record.kept_tests, record.tests) == (0, 0)
