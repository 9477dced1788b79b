"""Runs on executors."""

import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import asdict

import pytest

from ema_study.execution import execute, study_pool, time_executors
from ema_study.plan import Job

JOBS = [
    Job("fast", 10, "de", "friction low", "low", run, "all_generations", 8, 2) for run in (1, 2, 3)
]


def results(done):
    return {result.job.run: result.estimate for result in done}


@pytest.fixture(scope="module")
def serial():
    with study_pool("serial", 1) as executor:
        return results(execute(JOBS, executor))


def test_threads_find_what_a_single_one_does(serial):
    with study_pool("threads", 2) as executor:
        assert results(execute(JOBS, executor)) == serial


@pytest.mark.long
def test_processes_find_what_a_single_one_does(serial):
    with study_pool("processes", 2) as executor:
        assert results(execute(JOBS, executor)) == serial


@pytest.mark.long
def test_dask_cluster_of_local_workers_finds_what_a_single_one_does(serial, tmp_path):
    """In a process of its own: the threads of Dask's client stay until its end."""
    script = f"""
import json
from pathlib import Path
from ema_study.execution import execute, study_pool
from ema_study.plan import Job
jobs = [Job(**job) for job in {[asdict(job) for job in JOBS]!r}]
if __name__ == "__main__":
    with study_pool("dask", 2) as pool:
        done = list(execute(jobs, pool))
    print(json.dumps([[one.job.run, one.estimate] for one in done]))
"""
    (tmp_path / "study.py").write_text(script)
    done = subprocess.run(
        [sys.executable, tmp_path / "study.py"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert dict(json.loads(done.stdout.splitlines()[-1])) == serial


@pytest.fixture
def interruptible():
    """Where the tests run in the background, interrupts are ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_interrupt_cancels_runs_that_have_begun():
    """Without it, each of these would take minutes."""
    long = [
        Job("fast", 10, "de", "friction low", "low", run, "all_generations", 50, 100_000)
        for run in range(4)
    ]

    def study():
        with study_pool("threads", 2) as executor:
            list(execute(long, executor))

    interrupt = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    interrupt.start()
    with pytest.raises(KeyboardInterrupt):
        study()
    interrupt.join()


@pytest.mark.parametrize(
    ("kind", "workers", "message"),
    [
        ("cluster", 2, "executor 'cluster' is unknown; known: processes, threads, serial, dask"),
        ("threads", 0, "workers = 0: expected at least 1"),
    ],
)
def test_impossible_executor_is_refused(kind, workers, message):
    with pytest.raises(ValueError, match=message), study_pool(kind, workers):
        pass


@pytest.mark.long
def test_timing_compares_each_mode_with_one_core():
    frame = time_executors("fast", workers=2)
    assert frame["how"].str.contains("one core|all cores|processes").tolist() == [True] * 3
    assert frame["workers"].tolist() == [1, 1, 2]
    assert (frame["seconds"] > 0.0).all()
    assert frame["speedup"].to_numpy() == pytest.approx(frame["seconds"][0] / frame["seconds"])
