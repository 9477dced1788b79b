"""What the kernels of the monitor leave on the disk is none of the simulator's business."""

import subprocess
import sys

import pytest

from ema_monitor.model.monitor_model import compile_kernels, run_lanes

SIMULATE = """
import sys
from ema_sim.actuator import SimulatedActuator
SimulatedActuator().advance([0.0])
print(*sorted(name for name in sys.modules if name.split(".")[0] == "ema_monitor"))
"""


@pytest.mark.slow
def test_simulator_does_not_load_the_monitor_from_its_kernels():
    """They share functions, whose index in the cache names the types each was compiled for.

    Reading it brings in the modules of those types, which must be of everyone's own. The cache is
    that of these very sources; compiling anew would only take longer.
    """
    compile_kernels()
    assert run_lanes.stats.cache_hits or run_lanes.stats.cache_misses
    done = subprocess.run(
        [sys.executable, "-c", SIMULATE], capture_output=True, text=True, check=True, timeout=100
    )
    assert done.stdout.strip() == ""
