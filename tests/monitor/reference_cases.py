"""Faults of the thesis's cases, which the tests of the identification share."""

from ema_core.faults import FAULT_NAMES
from ema_study import cases as study

SINGLE = {name: case.faults for name, case in study.CASES.items() if case.level}
# Each fault at once, none of them small.
WIDE = dict(zip(FAULT_NAMES, (0.35, 0.2, 0.1, 0.3, 0.05, 0.3, 0.2, 0.4), strict=True))
CASES = {
    "healthy": {},
    **{name: case.faults for name, case in study.CASES.items()},
    "wide": WIDE,
}
