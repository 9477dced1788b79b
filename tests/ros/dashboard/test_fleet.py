# SPDX-License-Identifier: Apache-2.0
"""The dashboard serves the summary of an archive, within bounds."""

import json

import pyarrow as pa
import pytest

from ema_archive.store import FILE, Store, insert
from ema_archive.tables import UNIT_TABLES, placed
from ema_dashboard.contents import FleetDocument

UNIT = {"actuator_id": "flap", "serial_number": "7", "level": 1, "hours": 12.0}


def write(archive, units):
    with Store(archive, is_new=True) as store, store.changing() as db:
        rows = pa.Table.from_pylist(units, UNIT_TABLES["units"])
        insert(db, "units", placed(rows, "F", "flap+7"))


@pytest.fixture
def archive(tmp_path):
    folder = tmp_path / "hangar_7"
    folder.mkdir()
    write(folder, [UNIT])
    return folder


def test_summary_is_read_from_the_configured_archive(session, web, archive):
    node = session.dashboard(archive=str(archive))
    code, headers, content = web.get(f"{node.address}fleet.json?most=5")
    assert (code, headers["Content-Type"]) == (200, "application/json")
    summary = json.loads(content)
    assert summary["archive"] == "hangar_7"
    assert [row["serial_number"] for row in summary["worst"]] == ["7"]
    assert summary["levels"]["warn"] == 1
    assert web.get(f"{node.address}fleet.json", headers={"Host": "evil.example"})[0] == 403
    write(archive, [UNIT | {"level": 2}])
    assert json.loads(web.get(f"{node.address}fleet.json")[2])["levels"]["error"] == 1


@pytest.mark.parametrize("most", ["0", "101", "-1", "x", "²", "9" * 5000])
def test_summary_with_too_many_rows_is_refused(archive, most):
    made = FleetDocument(str(archive))({"most": most}, "")
    assert made.status == 503
    assert "expected 1 to 100" in json.loads(made.content)["reason"]


def test_missing_or_damaged_archive_is_reported(archive, tmp_path):
    for folder in (tmp_path / "nothing", archive):
        (archive / FILE).write_bytes(b"no table")
        made = FleetDocument(str(folder))({}, "")
        assert made.status == 503
        assert json.loads(made.content)["reason"]
