# SPDX-License-Identifier: Apache-2.0
"""A ninth fault needs only an entry in the registry, its physics and a field of the vector.

The messages need a line as well; ``tests/core/test_faults.py`` compares their fields.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ema_core

ENTRY = """    Fault(
        name="viscosity", label="viscosity", kind="viscosity", healthy=0.0, highest=1.0,
        quantity="viscous damping", base=1.0, slope=20.0, unit="x nominal", mismatch=1e-3,
        limit=0.5, growth=TypicalGrowth("linear", 3e-4),
        damage=Damage.HOURS,
    ),
"""
CHANGES = (
    (')\n"""Components of the fault vector', ENTRY + ')\n"""Components of the fault vector'),
    (
        "    gain: float\n\n    @classmethod",
        "    gain: float\n    viscosity: float\n\n    @classmethod",
    ),
    ("zeta, _, gain = physical", "zeta, _, gain, viscosity = physical"),
    (
        "            f_s=plant.",
        "            C=plant.mechanics.C * viscosity,\n            f_s=plant.",
    ),
)

USE = """
import importlib, pkgutil, sys
import ema_archive, ema_core, ema_monitor, ema_sim, ema_study
from ema_core.faults import FAULT_NAMES, healthy_faults
assert len(FAULT_NAMES) == 9
for package in (ema_core, ema_sim, ema_monitor, ema_study, ema_archive):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if ".node" not in module.name and not module.name.endswith(("_node", "__main__")):
            importlib.import_module(module.name)

from ema_archive.tables import estimate_from, estimate_row
from ema_monitor import calibrate, find_windows, identify
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.history_entry import as_text, read_test
from ema_monitor.prognosis.service import Service
from ema_monitor.prognosis.settings import PrognosisSettings
from ema_monitor.reports import health_report
from ema_monitor.unit import Unit
from ema_core.description import ActuatorDescription
from ema_sim import simulate

calibration = calibrate(list(find_windows(simulate({}, 4, seed=5))))
settings = PrognosisSettings(service=Service(hours_per_cycle=10.0))
unit = Unit(History("flap", "1"), settings)
for window in find_windows(simulate({"viscosity": 0.3}, 3, seed=9)):
    estimate = identify(window, calibration=calibration)
    assert abs(estimate.faults.viscosity - 0.3) < 0.02, estimate
    assert sum(abs(estimate.faults - healthy_faults())) < 0.33, estimate
    outlook = unit.update(estimate, calibration.unit_parameters, settings)
    kept = read_test(as_text(unit.history.entries[-1])).estimate
    assert kept.faults == estimate.faults == estimate_from(estimate_row(estimate, 0)).faults
report = health_report(outlook, ActuatorDescription().unit_key)
assert [item.name for item in report.faults][-1] == "viscosity"
print("nine")
"""


@pytest.mark.slow
def test_ninth_fault_is_simulated_identified_and_tracked(tmp_path: Path):
    shutil.copytree(Path(ema_core.__file__).parent, tmp_path / "ema_core")
    registry = tmp_path / "ema_core" / "faults.py"
    text = registry.read_text()
    for before, after in CHANGES:
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    registry.write_text(text)
    (tmp_path / "use.py").write_text(USE)
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path / "kernels"),
        "PYTHONPATH": f"{tmp_path}:{os.environ['PYTHONPATH']}",
    }
    done = subprocess.run(
        [sys.executable, tmp_path / "use.py"], env=environment, capture_output=True, text=True
    )
    assert done.stdout == "nine\n", done.stderr[-3000:]
