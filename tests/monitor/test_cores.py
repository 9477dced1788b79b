"""Work spread over cores: all of it, once, at the same time, and by whom."""

import os
import subprocess
import sys
import threading

import pytest
from numba.core import config

from ema_monitor import cores
from ema_monitor.cores import on_all_cores


@pytest.fixture(autouse=True)
def two_cores(monkeypatch):
    monkeypatch.setattr(config, "NUMBA_NUM_THREADS", 2)


@pytest.mark.parametrize("tasks", [0, 1, 2, 3, 100])
def test_all_work_is_done_once(tasks):
    done = []
    on_all_cores(done.append, tasks)
    assert sorted(done) == list(range(tasks))


def test_two_pieces_of_work_run_at_the_same_time():
    both = threading.Barrier(2, timeout=8.0)

    def meet(_: int) -> None:
        both.wait()

    on_all_cores(meet, 2)


def test_single_piece_of_work_costs_no_thread(monkeypatch):
    monkeypatch.delattr(cores, "_helpers")
    threads = []
    on_all_cores(lambda _: threads.append(threading.current_thread()), 1)
    assert threads == [threading.current_thread()]


def test_failure_reaches_the_caller():
    both = threading.Barrier(2, timeout=8.0)
    caller = threading.current_thread()

    def work(number: int) -> None:
        both.wait()
        if threading.current_thread() is not caller:
            raise ArithmeticError(f"piece {number}")

    with pytest.raises(ArithmeticError, match="piece"):
        on_all_cores(work, 2)


AFTER_A_FORK = """
import os, threading
from ema_monitor.cores import on_all_cores

def meet():
    both = threading.Barrier(2, timeout=8.0)
    on_all_cores(lambda _: both.wait(), 2)

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


def test_forked_process_has_threads_of_its_own():
    subprocess.run(
        [sys.executable, "-c", AFTER_A_FORK],
        env=os.environ | {"NUMBA_NUM_THREADS": "2"},
        check=True,
        timeout=60,
    )
