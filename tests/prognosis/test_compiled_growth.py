# SPDX-License-Identifier: Apache-2.0
"""All kernels that track growth are compiled before a monitor becomes active."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import importlib, json, pkgutil
import numpy as np
from numba.core.dispatcher import Dispatcher
from ema_monitor.node.work.kernels import STEPS
from ema_monitor.prognosis import growth
from ema_monitor.prognosis.growth.tracker import Tracker
from tests.prognosis.tracked_lives import observed

modules = [
    importlib.import_module(f"{growth.__name__}.{one.name}")
    for one in pkgutil.iter_modules(growth.__path__)
]

def compiled():
    found = {
        f"{kernel.py_func.__module__}.{kernel.py_func.__name__}": kernel
        for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)
    }
    # Those that only others call are compiled within these.
    return {name: [str(one) for one in kernel.signatures] for name, kernel in found.items()}

STEPS["growth"]()
before, tracker, rng = compiled(), Tracker(), np.random.default_rng(0)
for number in range(80):
    faults = {"friction": 4e-3 * number + 0.01 * np.sin(number / 5), "gain": 0.5 - 2e-3 * number}
    tracker.update(observed(10.0 * number, faults, rng))
    tracker.predict()
after = compiled()
late = [name for name in after if after[name] != before[name]]
print(json.dumps({"compiled": sum(map(len, before.values())), "late": late}))
"""


@pytest.mark.slow
def test_first_tests_compile_no_kernel_of_growth():
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    compiled = json.loads(done.stdout)
    assert compiled["late"] == []
    assert compiled["compiled"] >= 3
