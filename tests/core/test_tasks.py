# SPDX-License-Identifier: Apache-2.0
"""Workers: each task has exactly one outcome, even if its worker dies, and uses one thread."""

import importlib.util
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from ema_core.array_environment import array_environment
from ema_core.tasks import WorkerLostError, Workers

from ..waiting import wait_for

# Workers import their functions by the name of a module on their path.
WORK = """
import os, signal

def square(number):
    return number * number

def fail(number):
    raise ValueError(f"{number} is refused")

def own_pid(_):
    return os.getpid()

def act(what):
    if isinstance(what, int):
        return what * what
    is_first = not what.exists()
    with what.open("a") as file:
        file.write("x")
    if is_first or what.name == "always":
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("work")
    (place / "work_of_tasks.py").write_text(WORK)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(place)
        yield place


@pytest.fixture(scope="module")
def work(folder):
    return importlib.import_module("work_of_tasks")


def test_threads_give_one_outcome_per_task_and_take_items_only_as_needed(work):
    taken = []

    def items():
        for number in range(100):
            taken.append(number)
            yield number

    with Workers("threads", 2) as workers:
        outcomes = workers.run(work.square, items())
        first = next(outcomes)
        assert len(taken) <= 2 * 2 + 3
        results = {outcome.item: outcome.result() for outcome in (first, *outcomes)}
        assert results == {number: number**2 for number in range(100)}
        part = workers.run(work.square, range(10))
        next(part)
        part.close()
        assert {outcome.item for outcome in workers.run(work.square, range(10, 14))} == {
            10,
            11,
            12,
            13,
        }


def test_error_of_a_task_becomes_its_outcome(work):
    with Workers("threads", 1) as workers:
        [outcome] = workers.run(work.fail, [3])
    assert outcome.value is None
    with pytest.raises(ValueError, match="3 is refused"):
        outcome.result()


@pytest.mark.slow
def test_interrupted_process_pool_ends_without_an_error(work):
    """An exception in a thread would make this test fail."""

    def interrupt():
        with Workers("processes", 2) as workers:
            next(workers.run(work.square, range(1000)))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupt()


def test_killed_worker_loses_no_task(work, tmp_path):
    once, always = tmp_path / "once", tmp_path / "always"
    with Workers("processes", 2) as workers:
        outcomes = {
            outcome.item: outcome for outcome in workers.run(work.act, [once, always, *range(6)])
        }
        assert [outcomes[number].value for number in range(6)] == [0, 1, 4, 9, 16, 25]
        assert outcomes[once].value == "done"
        assert isinstance(outcomes[always].error, WorkerLostError)
        assert 2 <= len(always.read_text()) <= 3
        # Workers that are killed while idle are replaced.
        pids = {outcome.result() for outcome in workers.run(work.own_pid, range(4))}
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        assert not pids & {outcome.result() for outcome in workers.run(work.own_pid, range(4))}


@pytest.mark.slow
def test_workers_end_when_their_parent_is_killed(folder):
    script = """
import sys
import work_of_tasks
from ema_core.tasks import Workers
if __name__ == "__main__":
    with Workers("processes", 2) as workers:
        print(*[one.result() for one in workers.run(work_of_tasks.own_pid, range(4))], flush=True)
        sys.stdin.read()
"""
    (folder / "parent.py").write_text(script)
    with subprocess.Popen(
        [sys.executable, folder / "parent.py"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        pids = {int(word) for word in parent.stdout.readline().split()}
        parent.kill()
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids), "the workers' end")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (("cluster", 2), "executor 'cluster' is unknown; known: processes, threads, dask"),
        (("threads", 0), "workers = 0: expected at least 1"),
        (("threads", 1, "tcp://x:1"), "--scheduler tcp://x:1 requires the executor dask, not"),
    ],
)
def test_impossible_workers_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        Workers(*settings)


def run_script(folder: Path, body: str, *arguments: object) -> str:
    """Run a script in the folder of the work; return its output.

    It runs in a separate process, because the threads of Dask's client run until its process ends.
    """
    lines = "".join(f"    {line}\n" for line in body.strip().splitlines())
    path = folder / "script.py"
    path.write_text(
        "import socket, subprocess, sys, time\nfrom pathlib import Path\n"
        "import work_of_tasks as work\nfrom ema_core import tasks\n"
        f"if __name__ == '__main__':\n{lines}"
    )
    done = subprocess.run(
        [sys.executable, path, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), *sys.path[1:]])},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@pytest.mark.long
def test_killed_workers_of_a_cluster_lose_no_task(folder, tmp_path):
    body = """
folder = Path(sys.argv[1])
items = [folder / "once", folder / "always", *range(4)]
with tasks.Workers("dask", 2) as workers:
    found = {one.item: one for one in workers.run(work.act, items)}
assert type(found[folder / "always"].error).__name__ == "WorkerLostError"
print(found[folder / "once"].value, [found[number].value for number in range(4)])
"""
    assert run_script(folder, body, tmp_path) == "done [0, 1, 4, 9]\n"


@pytest.mark.long
def test_unreachable_or_ended_scheduler_is_named(folder):
    body = """
tasks._MOST_SILENCES = 3
tasks._CONNECT_S = 1.0
address = "tcp://127.0.0.1:" + sys.argv[1]
try:
    tasks.Workers("dask", 1, address)
except tasks.ClusterLostError as error:
    print(error)
tasks._CONNECT_S = 10.0
dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
scheduler = subprocess.Popen([*dask, "--host", "127.0.0.1", "--port", sys.argv[1],
    "--no-dashboard", "--no-show"], stderr=subprocess.DEVNULL)
# A busy machine starts it later than a client waits.
while True:
    try:
        socket.create_connection(("127.0.0.1", int(sys.argv[1]))).close()
        break
    except ConnectionRefusedError:
        time.sleep(0.1)
def items():
    yield 3
    # No worker: the first waits.
    scheduler.kill()
    scheduler.wait()
try:
    with tasks.Workers("dask", 1, address) as workers:
        list(workers.run(work.square, items()))
except tasks.ClusterLostError as error:
    print(error)
"""
    printed = run_script(folder, body, free_port())
    assert "does not answer within 1 s" in printed
    assert "is unreachable; finished tasks are kept" in printed


# Large enough for numpy to use several threads, if there are several processors.
ARRAYS = """
import os, resource
import numpy as np
def main():
    np.ones((400, 400)) @ np.ones((400, 400))
    began = resource.getrusage(0).ru_minflt
    for _ in range(100): np.ones(100_000)
    print(len(os.listdir("/proc/self/task")), resource.getrusage(0).ru_minflt - began)
"""


def test_program_uses_one_thread_and_reuses_memory(tmp_path):
    (tmp_path / "arrays.py").write_text(ARRAYS)
    printed = array_environment({})
    unsaid = {name: value for name, value in os.environ.items() if name not in printed}
    # Arrays in newly mapped memory cause faults in 19,600 pages.
    for environment, most in ((unsaid, 30_000), (unsaid | printed, 1000)):
        words = [sys.executable, "-c", "from ema_core.start import program; program('arrays')()"]
        done = subprocess.run(words, cwd=tmp_path, env=environment, stdout=-1, check=True)
        threads, faults = map(int, done.stdout.split())
        assert (threads, faults < most) == (1, True)
