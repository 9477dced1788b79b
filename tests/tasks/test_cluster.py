"""A Dask cluster: workers and schedulers that are killed. Each test in a process of its own.

The threads of Dask's client stay until its process ends.
"""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

HERE = Path(__file__).parent
PREAMBLE = f"""
import sys
sys.path.append({str(HERE)!r})
import work
from pathlib import Path
from ema_tasks.choice import open_pool
from ema_tasks.pool import ClusterLostError, WorkerLostError
"""


def run(folder: Path, script: str, *arguments: object) -> str:
    """Run a script; return what it printed."""
    path = folder / "script.py"
    lines = "".join(f"    {line}\n" for line in script.strip().splitlines())
    path.write_text(f"{PREAMBLE}\nif __name__ == '__main__':\n{lines}")
    done = subprocess.run(
        [sys.executable, path, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE), *sys.path[1:]])},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_killed_workers_of_a_cluster_take_no_task_along(tmp_path):
    told = run(
        tmp_path,
        """
folder = Path(sys.argv[1])
with open_pool("dask", 2) as pool:
    pool.submit("once", work.kill_once, folder / "once")
    pool.submit("always", work.kill_always, folder / "always")
    for number in range(4):
        pool.submit(number, work.square, number)
    outcomes = {}
    while pool.pending:
        one = pool.next()
        assert one.name not in outcomes
        outcomes[one.name] = one
    assert pool.dashboard.startswith("http://127.0.0.1:")
assert isinstance(outcomes["always"].error, WorkerLostError)
print(outcomes["once"].value, [outcomes[number].value for number in range(4)])
""",
        tmp_path,
    )
    assert told == "done [0, 1, 4, 9]\n"


AT_ITS_END = {
    "waiting": "pool.next()",
    "submitting": """for number in range(500):
            pool.submit(number, work.square, number)
            pool.has_room, pool.workers
        pool.next()""",
}


@pytest.mark.parametrize("doing", AT_ITS_END)
def test_scheduler_that_ends_is_named(tmp_path, doing):
    told = run(
        tmp_path,
        """
import subprocess
from ema_tasks import cluster
cluster._MOST_SILENCES = 3
address = "tcp://127.0.0.1:" + sys.argv[1]
dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
scheduler = subprocess.Popen([*dask, "--host", "127.0.0.1", "--port", sys.argv[1],
    "--no-dashboard", "--no-show"], stderr=subprocess.DEVNULL)
try:
    with open_pool("dask", 1, address) as pool:
        # No worker: it waits.
        pool.submit("waits", work.square, 3)
        scheduler.kill()
        scheduler.wait()
        DOING
except ClusterLostError as error:
    print(error)
""".replace("DOING", AT_ITS_END[doing]),
        free_port(),
    )
    assert "the Dask scheduler tcp://127.0.0.1:" in told
    assert "is out of reach; what is done is kept" in told


def test_scheduler_that_does_not_answer_is_named(tmp_path):
    told = run(
        tmp_path,
        """
from ema_tasks import cluster
cluster.CONNECT_S = 1.0
try:
    open_pool("dask", 1, "tcp://127.0.0.1:" + sys.argv[1])
except ClusterLostError as error:
    print(error)
""",
        free_port(),
    )
    assert "does not answer within 1 s" in told


def free_port() -> int:
    """Return a port that nothing listens on."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]
