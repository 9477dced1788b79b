"""Names of units and models as those of folders."""

import pyarrow as pa
import pytest

from ema_archive.bag_task import unit_name
from ema_archive.partitions import read_state, read_unit, shortened, write_health, write_state
from ema_archive.tables import HEALTH

LONG = "левый закрылок внешний"
NAMES = ("flap", "a/b", "é", LONG, 5 * LONG, "x" * 240, "x" * 241, "x" * 1000)


@pytest.mark.parametrize("actuator_id", NAMES)
def test_unit_of_any_name_has_its_files(tmp_path, actuator_id):
    unit, model = unit_name(actuator_id, LONG), shortened(actuator_id)
    rows = pa.Table.from_pylist([{"actuator_id": actuator_id, "stamp_ns": 1}], HEALTH)
    write_health(tmp_path, model, unit, rows)
    assert read_unit(tmp_path, "health", unit).to_pylist() == rows.to_pylist()
    (tmp_path / "state").mkdir()
    write_state(tmp_path, unit, b"state")
    assert read_state(tmp_path, unit) == b"state"


def test_long_names_stay_apart():
    units = {unit_name(name, serial) for name in NAMES for serial in ("1", "2", LONG, 3 * LONG)}
    assert len(units) == 4 * len(NAMES)
    assert unit_name("left flap", "2031/7") == "left flap+2031%2F7"
    assert shortened("x" * 240) == "x" * 240
