"""``ema thesis``: the study from the command line, small, and interrupted."""

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
    """A study of six short runs, without the timing of executors; its report takes seconds."""
    plans = []

    def plan(model, runs, *, with_trials):
        plans.append((model, runs, with_trials))
        return [job for job in JOBS if job.run <= runs]

    monkeypatch.setattr(command, "plan", plan)
    monkeypatch.setattr(command, "_timing", lambda folder, models: pd.DataFrame())
    return plans


@pytest.fixture
def without_report(monkeypatch):
    """Neither report nor tables, which take longer than the runs."""
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


def test_what_is_there_is_not_run_again(ema, tmp_path, small, without_report):
    folder = tmp_path / "study"
    assert ema("thesis", "-o", folder, "--runs", "1", *HERE).exit_code == 0
    before = (folder / "runs.jsonl").read_text()
    result = ema("thesis", "-o", folder, "--runs", "2", *HERE)
    assert result.exit_code == 0, result.output
    assert f"3 of {len(JOBS)} runs are already done" in result.output
    after = (folder / "runs.jsonl").read_text()
    assert after.startswith(before)
    assert len(after.splitlines()) == len(JOBS)


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
def test_quick_is_two_runs_without_table_8_and_models_add_up(
    ema, tmp_path, small, without_report, options, planned
):
    result = ema("thesis", "-o", tmp_path / "study", *options, *HERE)
    assert result.exit_code == 0, result.output
    assert small == planned


def test_folder_in_use_is_refused(ema, tmp_path, small):
    with RunStore(tmp_path):
        result = ema("thesis", "-o", tmp_path, *HERE)
    assert result.exit_code == 1
    assert "is in use by another study" in result.stderr


def test_worker_that_was_killed_is_reported_in_a_line(ema, tmp_path, small, monkeypatch):
    def execute(jobs, workers):
        raise WorkerLostError("3 worker processes ended while they worked on it")

    monkeypatch.setattr(command, "execute", execute)
    result = ema("thesis", "-o", tmp_path, *HERE)
    assert result.exit_code == 1
    assert "3 worker processes ended while they worked on it; the runs so far" in result.stderr


@pytest.mark.long
def test_interrupted_study_keeps_its_runs_and_resumes(tmp_path):
    """As Ctrl-C does: the signal goes to the whole process group."""
    folder = tmp_path / "study"
    study = subprocess.Popen(
        ["ema", "thesis", "-o", folder, "--quick"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # Where the tests run in the background, interrupts are ignored, which children inherit.
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    runs = folder / "runs.jsonl"
    try:
        # Three processes import and load kernels first, on whatever cores are left.
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
