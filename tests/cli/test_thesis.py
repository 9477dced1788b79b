# SPDX-License-Identifier: Apache-2.0
"""``ema thesis``: a small study on the command line, also interrupted."""

import json
import os
import signal
import subprocess
from contextlib import suppress
from functools import partial

import pandas as pd
import pytest

from ema_cli.commands import thesis as command
from ema_core.tasks import WorkerLostError
from ema_study.plan import Job
from ema_study.store import RunStore

from ..waiting import DEADLINE_S, wait_for

HERE = ("--executor", "threads")
JOBS = [
    Job("fast", table, algorithm, case, "low", run, "floor_corrected", 10, 3)
    for table, algorithm, case in (
        (12, "pso", "friction low"),
        (13, "de", "friction low"),
        (13, "de_thesis", "friction low"),
    )
    for run in (1, 2)
]


@pytest.fixture
def small(monkeypatch):
    """Return a study of six short runs, without timing of executors; its report takes seconds."""
    plans = []

    def plan(model, runs, *, with_trials):
        plans.append((model, runs, with_trials))
        return [job for job in JOBS if job.run <= runs]

    monkeypatch.setattr(command, "plan", plan)
    monkeypatch.setattr(command, "_timing", lambda folder, models: pd.DataFrame())
    return plans


@pytest.fixture
def without_report(monkeypatch):
    """Skip report and tables, which take longer than the runs."""
    monkeypatch.setattr(command, "study_tables", lambda frame: [])
    monkeypatch.setattr(command, "write_report", lambda folder, *_: folder / "report.html")


@pytest.mark.long
def test_study_leaves_runs_tables_and_report(ema, tmp_path, small):
    folder = tmp_path / "study"
    result = ema("thesis", "-o", folder, "--runs", "2", *HERE)
    assert result.exit_code == 0, result.output
    runs = pd.read_csv(folder / "runs.csv")
    assert sorted(zip(runs["table"], runs["algorithm"], runs["run"], strict=True)) == sorted(
        (job.table, job.algorithm, job.run) for job in JOBS
    )
    assert "error_percent" in runs.columns
    assert (folder / "tables" / "table_12.csv").exists()
    assert "</html>" in (folder / "report.html").read_text()
    assert "6 runs in" in result.output
    assert "pso" in result.output


def test_existing_runs_are_not_repeated(ema, tmp_path, small, without_report):
    folder = tmp_path / "study"
    assert ema("thesis", "-o", folder, "--runs", "1", *HERE).exit_code == 0
    before = (folder / "runs.jsonl").read_text()
    result = ema("thesis", "-o", folder, "--runs", "2", *HERE)
    assert result.exit_code == 0, result.output
    assert f"3 of {len(JOBS)} runs are already done" in result.output
    after = (folder / "runs.jsonl").read_text()
    assert after.startswith(before)
    assert len(after.splitlines()) == len(JOBS)


def test_one_table_is_made_and_printed_without_a_report(ema, tmp_path, monkeypatch):
    def jobs_of(number, model, runs):
        return [job for job in JOBS if job.table == number and job.run <= runs]

    monkeypatch.setattr(command, "jobs_of", jobs_of)
    result = ema("thesis", "--table", "13", "-o", tmp_path, "--runs", "1", *HERE)
    assert result.exit_code == 0, result.output
    assert result.output.startswith("Table 13: Friction low, DE")
    assert result.output.index("printed") < result.output.index("fast model")
    runs = pd.read_csv(tmp_path / "runs.csv")
    assert runs["table"].tolist() == [13, 13]
    written = pd.read_csv(tmp_path / "tables" / "table_13.csv", index_col=0)
    errors = runs.set_index("algorithm")["error_percent"]
    assert written.loc["1", "fast model: error [%]"] == errors["de"]
    assert written.loc["1", "fast model, thesis's code: error [%]"] == errors["de_thesis"]
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize("number", ["7", "62", "-1"])
def test_unknown_table_is_refused_with_the_tables_that_exist(ema, tmp_path, number):
    result = ema("thesis", "--table", number, "-o", tmp_path / "study")
    assert result.exit_code == 2
    assert f"table {number}: expected 8 to 61" in result.stderr
    assert not (tmp_path / "study").exists()


def test_help_lists_the_tables(ema):
    output = " ".join(ema("thesis", "--help").output.split())
    assert "11 to 55 single faults" in output
    assert "(docs/study.md)" in output


@pytest.mark.parametrize(
    ("options", "planned"),
    [
        (("--quick",), [("fast", command.QUICK_RUNS, False)]),
        (
            ("--model", "thesis", "--model", "fast", "--model", "thesis", "--runs", "1"),
            [("thesis", 1, True), ("fast", 1, True)],
        ),
    ],
)
def test_quick_is_two_runs_without_table_8_and_models_accumulate(
    ema, tmp_path, small, without_report, options, planned
):
    result = ema("thesis", "-o", tmp_path / "study", *options, *HERE)
    assert result.exit_code == 0, result.output
    assert small == planned


def test_folder_in_use_is_refused(ema, tmp_path, small):
    with RunStore(tmp_path):
        result = ema("thesis", "-o", tmp_path, *HERE)
    assert result.exit_code == 1
    assert "is in use by another process" in result.stderr


def test_worker_that_was_killed_is_reported_in_a_line(ema, tmp_path, small, monkeypatch):
    def execute(jobs, workers):
        raise WorkerLostError("3 worker processes ended while they worked on it")

    monkeypatch.setattr(command, "execute", execute)
    result = ema("thesis", "-o", tmp_path, *HERE)
    assert result.exit_code == 1
    assert "3 worker processes ended while they worked on it; the runs so far" in result.stderr


@pytest.mark.long
def test_interrupted_study_keeps_its_runs_and_resumes(tmp_path):
    """The signal goes to the whole process group, as from Ctrl-C."""
    folder = tmp_path / "study"
    study = subprocess.Popen(
        ["ema", "thesis", "-o", folder, "--quick"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # If the tests run in the background, SIGINT is ignored, and child processes inherit that.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    runs = folder / "runs.jsonl"
    try:
        # Three processes first import and load kernels, possibly on few cores.
        wait_for(lambda: runs.exists() and runs.read_text().count("\n") >= 2, "two runs")
        assert study.poll() is None
        os.killpg(study.pid, signal.SIGINT)
        output, _ = study.communicate(timeout=DEADLINE_S)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(study.pid, signal.SIGKILL)
    assert study.returncode == 1
    assert "Traceback" not in output
    assert "the same command resumes" in output
    done = runs.read_text().splitlines()
    assert len(done) >= 2
    assert all(json.loads(line)["job"]["algorithm"] for line in done)
