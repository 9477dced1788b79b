# SPDX-License-Identifier: Apache-2.0
"""The folder of a study loses no runs, and does not mix runs of different versions."""

import json
from dataclasses import asdict

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
def results():
    return [run_job(job) for job in JOBS]


def fill(folder, results):
    with RunStore(folder) as store:
        for result in results:
            store.add(result)


def reopened(folder):
    with RunStore(folder) as store:
        return store


def test_runs_are_read_as_written(tmp_path, results):
    fill(tmp_path, results[:2])
    again = reopened(tmp_path)
    assert again.results == results[:2]
    assert again.missing(JOBS) == JOBS[2:]


def test_truncated_line_is_dropped_and_run_again(tmp_path, results):
    fill(tmp_path, results[:2])
    path = tmp_path / "runs.jsonl"
    path.write_bytes(path.read_bytes()[:-40])
    assert reopened(tmp_path).missing(JOBS) == JOBS[1:]
    fill(tmp_path, results[1:2])
    assert reopened(tmp_path).results == results[:2]


@pytest.mark.parametrize(
    "line",
    ["{", "[]", '{"version": "%s", "cost": 1.0}', '{"version": "%s", "rust": 2, "job": __JOB__}'],
)
def test_damaged_line_is_named(tmp_path, results, line):
    fill(tmp_path, results[:2])
    path = tmp_path / "runs.jsonl"
    lines = path.read_text().splitlines()
    line = line.replace("%s", store_module.numerics_version())
    line = line.replace("__JOB__", json.dumps(asdict(JOBS[0])))
    path.write_text("\n".join([lines[0], line]) + "\n")
    with pytest.raises(ValueError, match=r"runs\.jsonl, line 2 is damaged: expected a run"):
        RunStore(tmp_path)
    # And the folder is unlocked again.
    path.write_text(lines[0] + "\n")
    assert reopened(tmp_path).results == results[:1]


def test_folder_belongs_to_one_study_at_a_time(tmp_path):
    with RunStore(tmp_path), pytest.raises(ValueError, match="is in use by another process"):
        RunStore(tmp_path)
    reopened(tmp_path)


def test_runs_with_different_numerics_are_refused(tmp_path, results, monkeypatch):
    fill(tmp_path, results[:1])
    monkeypatch.setattr(store_module, "numerics_version", lambda: "another")
    with pytest.raises(
        ValueError, match=r"different version of models or algorithms .* expected another"
    ):
        RunStore(tmp_path)


def test_export_has_every_run(tmp_path, results):
    with RunStore(tmp_path) as store:
        for result in results:
            store.add(result)
        store.export()
    table = pd.read_csv(tmp_path / "runs.csv")
    assert table["run"].tolist() == [1, 2, 3]
    assert table["error_percent"].tolist() == [r.error_percent for r in results]
