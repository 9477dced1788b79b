import signal
import subprocess
import time

import pytest

from ema_recording.reader import Bag


@pytest.mark.parametrize("attempt", range(3))
def test_interrupted_simulation_leaves_a_closed_bag(tmp_path, attempt):
    # An interrupt that met a kernel on its way back to Python used to crash the process; where it
    # meets the process is chance, hence the attempts.
    path = tmp_path / "long.mcap"
    with subprocess.Popen(
        ["ema", "simulate", "--cycles", "100000", "-o", path], stderr=subprocess.PIPE, text=True
    ) as process:
        deadline = time.monotonic() + 60.0
        while not path.exists() or path.stat().st_size < 200_000 * (attempt + 1):
            if process.poll() is not None or time.monotonic() > deadline:
                process.kill()
                pytest.fail(f"no recording came to be: {process.communicate()[1]}")
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=20)
    assert (process.returncode, error.strip()) == (1, "Aborted!")
    bag = Bag(path)
    assert bag.damage == ""
    assert bag.topics["/ema/telemetry"].count > 50
