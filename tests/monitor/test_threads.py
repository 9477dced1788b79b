# SPDX-License-Identifier: Apache-2.0
"""Work shared by threads is done completely, once and concurrently."""

import subprocess
import sys
import threading

import pytest

from ema_monitor.model import threads as model_threads
from ema_monitor.model.threads import limit_threads, run_in_threads

from ..waiting import DEADLINE_S


@pytest.fixture(autouse=True)
def two_threads():
    limit_threads(2)
    yield
    limit_threads(None)


@pytest.mark.parametrize("tasks", [0, 1, 2, 3, 100])
def test_all_work_is_done_once(tasks):
    done = []
    run_in_threads(done.append, tasks)
    assert sorted(done) == list(range(tasks))


def test_two_work_items_run_at_the_same_time():
    both = threading.Barrier(2, timeout=DEADLINE_S)

    def meet(_: int) -> None:
        both.wait()

    run_in_threads(meet, 2)


def test_single_work_item_starts_no_thread(monkeypatch):
    monkeypatch.delattr(model_threads, "_pool")
    threads = []
    run_in_threads(lambda _: threads.append(threading.current_thread()), 1)
    assert threads == [threading.current_thread()]


def test_failure_is_raised_in_the_caller():
    both = threading.Barrier(2, timeout=DEADLINE_S)
    caller = threading.current_thread()

    def work(number: int) -> None:
        both.wait()
        if threading.current_thread() is not caller:
            raise ArithmeticError(f"piece {number}")

    with pytest.raises(ArithmeticError, match="piece"):
        run_in_threads(work, 2)


AFTER_A_FORK = """
import os
import sys
import threading

from ema_monitor.model.threads import limit_threads, run_in_threads

def meet():
    both = threading.Barrier(2, timeout=float(sys.argv[1]))
    run_in_threads(lambda _: both.wait(), 2)

limit_threads(2)
meet()
child = os.fork()
if child == 0:
    try:
        meet()
    except BaseException:
        os._exit(1)
    os._exit(0)
assert os.waitpid(child, 0)[1] == 0
"""


def test_forked_process_has_its_own_threads():
    command = [sys.executable, "-c", AFTER_A_FORK, f"{DEADLINE_S:g}"]
    subprocess.run(command, check=True, timeout=2 * DEADLINE_S)
