"""Faults of the thesis's cases, which the tests of the identification share."""

from ema_core.faults import FAULT_NAMES

# The thesis's ten single faults (its tables 11 to 54) and its multiple one (table 56).
SINGLE = {
    "friction low": {"friction": 0.25},
    "friction high": {"friction": 0.75},
    "backlash low": {"backlash": 9 / 99},
    "backlash high": {"backlash": 74 / 99},
    "short circuit low": {"short_circuit_a": 0.2},
    "short circuit high": {"short_circuit_a": 0.7},
    "eccentricity low": {"eccentricity": 0.25},
    "eccentricity high": {"eccentricity": 0.75},
    "gain low": {"gain": 0.25},
    "gain high": {"gain": 0.75},
}
MULTIPLE = dict(
    zip(FAULT_NAMES, (0.0068, 0, 9.19e-3, 0.0013, 8.6e-4, 0.0111, 0.627, 0.38038), strict=True)
)
# Each fault at once, none of them small.
WIDE = dict(zip(FAULT_NAMES, (0.35, 0.2, 0.1, 0.3, 0.05, 0.3, 0.2, 0.4), strict=True))
CASES = {"healthy": {}, **SINGLE, "multiple": MULTIPLE, "wide": WIDE}
