# SPDX-License-Identifier: Apache-2.0
"""Fields of estimates and healths have the same names in messages, JSON, tables and document."""

from dataclasses import fields, is_dataclass
from pathlib import Path
from runpy import run_path
from typing import Any

import pytest

from ema_archive.tables import BAG_TABLES
from ema_core.faults import FAULT_NAMES
from ema_monitor import reports
from ema_monitor.identification.estimate import Estimate, estimate_record, refusal
from ema_monitor.identification.search_settings import SearchSettings
from ema_monitor.reasons import MotorStill, NoCalibration, StatedReason
from ema_monitor.windows.trigger import Refusal

RECORDS: dict[str, Any] = run_path(str(Path(__file__).parents[2] / "tools" / "records.py"))
REPORTS = {
    "Health": reports.HealthReport,
    "FaultHealth": reports.ItemReport,
    "RemainingUsefulLife": reports.LifeReport,
    "ScenarioLife": reports.ScenarioReport,
    "UnitEvent": reports.EventReport,
}


def names_of(message: str) -> list[str]:
    return [field.name for field in RECORDS["message_fields"](message)]


def test_page_is_up_to_date():
    text = RECORDS["PAGE"].read_text(encoding="utf-8")
    assert text == RECORDS["records_page"](), "make records"


def test_estimate_has_the_names_of_its_message():
    names = {item.name for item in fields(Estimate)}
    represented = RECORDS["REPRESENTED"]
    assert set(represented) | set(RECORDS["JSON_ALONE"]) <= names
    expected = {represented.get(name, name) for name in names - set(RECORDS["JSON_ALONE"])}
    assert expected | {*RECORDS["UNIT"], *RECORDS["MESSAGE_ALONE"]} == set(
        names_of("FaultEstimate")
    )


def test_json_of_an_estimate_has_its_fields_and_their_reason():
    made = refusal(
        Refusal(1, 2, StatedReason("")), NoCalibration("c.yaml"), SearchSettings(), MotorStill()
    )
    assert set(estimate_record(made)) == {*(item.name for item in fields(Estimate)), "reason"}


def test_table_of_estimates_has_the_fields_of_an_estimate():
    names = {item.name for item in fields(Estimate)} - {"faults"} | {"reason"}
    columns = set(BAG_TABLES["estimates"].names)
    assert names <= columns
    sigmas = {f"{name}_sigma" for name in FAULT_NAMES}
    of_unit = {"actuator_id", "serial_number", "tested", "number", "bag", "bag_sha256"}
    assert columns - names == {*FAULT_NAMES, *sigmas, *of_unit, "software", "settings"}


@pytest.mark.parametrize("message", REPORTS)
def test_reports_have_the_fields_of_their_messages(message: str):
    assert is_dataclass(REPORTS[message])
    assert [item.name for item in fields(REPORTS[message])] == names_of(message)
