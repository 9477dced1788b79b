"""Pools of workers: every task has one outcome, whatever becomes of its worker."""

import importlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ema_tasks.choice import open_pool
from ema_tasks.local import ProcessPool, ThreadPool
from ema_tasks.pool import MOST_DEATHS, WorkerLostError

from ..waiting import wait_for

HERE = Path(__file__).parent
# Workers import it by this name from the path of this process; they do not know pytest's names.
sys.path.append(str(HERE))
work = importlib.import_module("work")


@pytest.fixture
def pool():
    with ProcessPool(2) as pool:
        yield pool


def test_processes_keep_to_one_thread_each_unless_the_user_wants_more(monkeypatch):
    name = "OPENBLAS_NUM_THREADS"
    for said, wanted in ((None, "1"), ("3", "3")):
        if said is None:
            monkeypatch.delenv(name, raising=False)
        else:
            monkeypatch.setenv(name, said)
        with ProcessPool(1) as pool:
            [outcome] = pool.run(work.environment_of, [name])
        assert outcome.result() == wanted
        assert os.environ.get(name) == said


def test_threads_give_one_outcome_a_task_and_take_no_more_than_needed():
    taken = []

    def items():
        for number in range(100):
            taken.append(number)
            yield number

    with ThreadPool(2) as pool:
        outcomes = pool.run(work.square, items())
        first = next(outcomes)
        assert len(taken) <= 2 * pool.workers + 3
        rest = list(outcomes)
    found = {one.name: one.result() for one in (first, *rest)}
    assert found == {number: number**2 for number in range(100)}
    assert pool.pending == 0


def test_error_of_a_task_is_its_outcome():
    with ThreadPool(1) as pool:
        [outcome] = pool.run(work.fail, [3])
    assert outcome.value is None
    with pytest.raises(ValueError, match="3 is refused"):
        outcome.result()


def test_outcomes_of_tasks_that_are_forgotten_do_not_come():
    with ThreadPool(1) as pool:
        first = pool.run(work.square, range(10))
        next(first)
        first.close()
        assert pool.pending == 0
        assert {one.name for one in pool.run(work.square, range(10, 14))} == {10, 11, 12, 13}


@pytest.mark.slow
def test_worker_that_is_killed_takes_no_task_along(pool, tmp_path):
    pool.submit("killed once", work.kill_once, tmp_path / "once")
    pool.submit("kills always", work.kill_always, tmp_path / "always")
    for number in range(6):
        pool.submit(number, work.square, number)
    outcomes = {}
    while pool.pending:
        one = pool.next()
        assert one.name not in outcomes
        outcomes[one.name] = one
    assert [outcomes[number].value for number in range(6)] == [0, 1, 4, 9, 16, 25]
    assert outcomes["killed once"].value == "done"
    assert isinstance(outcomes["kills always"].error, WorkerLostError)
    assert (tmp_path / "always").read_text() == MOST_DEATHS * "x"


@pytest.mark.slow
def test_worker_that_is_killed_while_it_waits_is_replaced(pool):
    pids = {one.result() for one in pool.run(work.own_pid, range(4))}
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    later = {one.result() for one in pool.run(work.own_pid, range(4))}
    assert not pids & later


@pytest.mark.slow
def test_task_beyond_its_time_is_ended():
    with ProcessPool(1, limit_s=0.3) as pool:
        outcomes = list(pool.run(work.sleep, [60.0, 0.0]))
    lost, done = sorted(outcomes, key=lambda one: -one.name)
    assert isinstance(lost.error, WorkerLostError)
    assert "took longer than 0.3 s" in str(lost.error)
    assert done.error is None


@pytest.mark.slow
def test_workers_end_with_a_killed_parent(tmp_path):
    script = f"""
import sys
sys.path.append({str(HERE)!r})
import work
from ema_tasks.local import ProcessPool
if __name__ == "__main__":
    with ProcessPool(2) as pool:
        print(*[one.result() for one in pool.run(work.own_pid, range(4))], flush=True)
        sys.stdin.read()
"""
    (tmp_path / "parent.py").write_text(script)
    with subprocess.Popen(
        [sys.executable, tmp_path / "parent.py"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        pids = {int(word) for word in parent.stdout.readline().split()}
        parent.kill()
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids), "the workers' end")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("cluster", 2), "executor 'cluster' is unknown; known: processes, threads, dask"),
        (("threads", 0), "workers = 0: expected at least 1"),
        (
            ("threads", 1, "tcp://x:1"),
            "--scheduler tcp://x:1 is for the executor dask, not threads",
        ),
    ],
)
def test_impossible_pool_is_refused(given, message):
    with pytest.raises(ValueError, match=message):
        open_pool(*given)
