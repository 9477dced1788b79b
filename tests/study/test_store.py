"""The folder of a study: nothing that was run is lost, nothing stale is mixed in."""

import json

import pandas as pd
import pytest

from ema_study import store as store_module
from ema_study.plan import Job
from ema_study.run import run_job
from ema_study.store import RunStore

JOBS = [
    Job("fast", 10, "de", "friction low", "low", run, "all_generations", 8, 1) for run in (1, 2, 3)
]


@pytest.fixture(scope="module")
def records():
    return [run_job(job) for job in JOBS]


def filled(folder, records):
    store = RunStore(folder)
    for record in records:
        store.add(record)
    return store


def test_runs_come_back_as_they_were(tmp_path, records):
    filled(tmp_path, records[:2])
    again = RunStore(tmp_path)
    # repr: the threshold is not a number in these runs.
    assert repr(again.records) == repr(records[:2])
    assert again.missing(JOBS) == JOBS[2:]


def test_cut_line_is_dropped_and_run_again(tmp_path, records):
    filled(tmp_path, records[:2])
    path = tmp_path / "runs.jsonl"
    path.write_bytes(path.read_bytes()[:-40])
    again = RunStore(tmp_path)
    assert again.missing(JOBS) == JOBS[1:]
    again.add(records[1])
    assert len(RunStore(tmp_path).records) == 2


def test_damaged_line_is_named(tmp_path, records):
    filled(tmp_path, records[:2])
    path = tmp_path / "runs.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(["{}", *lines[1:]]) + "\n")
    with pytest.raises(ValueError, match=r"runs\.jsonl is damaged in line 1"):
        RunStore(tmp_path)


def test_runs_of_other_numerics_are_refused(tmp_path, records, monkeypatch):
    filled(tmp_path, records[:1])
    monkeypatch.setattr(store_module, "numerics_version", lambda: "another")
    with pytest.raises(ValueError, match=r"other models or algorithms .* expected another"):
        RunStore(tmp_path)


def test_export_has_every_run(tmp_path, records):
    filled(tmp_path, records).export()
    table = pd.read_csv(tmp_path / "runs.csv")
    assert table["run"].tolist() == [1, 2, 3]
    assert table["error_percent"].tolist() == [r.error_percent for r in records]
    curves = json.loads((tmp_path / "runs.json").read_text())
    assert curves[0]["costs"] == pytest.approx(records[0].costs)
