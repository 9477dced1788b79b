# SPDX-License-Identifier: Apache-2.0
"""Faults shared by the tests of the identification: the cases of the thesis, and others."""

from ema_core.faults import FAULT_NAMES
from ema_study import cases as study

# All faults together, none of them small.
WIDE = dict(zip(FAULT_NAMES, (0.35, 0.2, 0.1, 0.3, 0.05, 0.3, 0.2, 0.4), strict=True))
CASES = {"healthy": {}, **{name: case.faults for name, case in study.CASES.items()}, "wide": WIDE}
# Faults that the model can simulate and identify again.
TRUTH = {
    "friction": 0.3,
    "backlash": 0.05,
    "short_circuit_b": 0.15,
    "eccentricity": 0.2,
    "eccentricity_phase": 0.8,
    "gain": 0.6,
}
