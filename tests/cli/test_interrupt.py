# SPDX-License-Identifier: Apache-2.0
import re
import signal
import subprocess

import pytest

from ema_bags.reader import Bag

from ..commands import without_progress
from ..waiting import DEADLINE_S, started, wait_for


@pytest.mark.parametrize("attempt", range(3))
def test_interrupted_simulation_leaves_a_closed_bag(tmp_path, attempt):
    # An interrupt in a kernel that returns to Python used to crash the process. The moment is
    # random, so the test repeats it.
    path = tmp_path / "long.mcap"
    with started(
        ["ema", "simulate", "--cycles", "100000", "-o", path], stderr=subprocess.PIPE, text=True
    ) as process:
        size = 200_000 * (attempt + 1)
        wait_for(lambda: path.exists() and path.stat().st_size >= size, "a recording")
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1
    text = rf"Error: stopped: {re.escape(str(path))} has \d+ of 100000 cycles and an incomplete one"
    assert re.fullmatch(text, without_progress(error).strip())
    bag = Bag(path)
    assert bag.damage == ""
    assert bag.topics["/ema/telemetry"].count > 50
