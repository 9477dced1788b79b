# SPDX-License-Identifier: Apache-2.0
"""Fault cases of the thesis: ten single faults and one multiple fault."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ema_core.faults import FAULT_NAMES, fault_vector

SINGLE_FAULTS: Final = ("friction", "backlash", "short_circuit", "eccentricity", "gain")
"""Kinds of single faults, in the order of the thesis's section 7.2."""

ALGORITHMS: Final = ("ga", "pso", "de", "gwo")
"""The four algorithms of the thesis, in the order of its tables."""

LEVELS: Final = ("low", "high")
"""Levels of a single fault."""

MULTIPLE: Final = "multiple"
"""Kind and name of the multiple fault."""

KIND_NAMES: Final = {name: name.replace("_", " ") for name in SINGLE_FAULTS} | {
    MULTIPLE: "multiple fault"
}
LEVEL_NAMES: Final = {level: level for level in LEVELS} | {
    "fast_stop": "study of speed",
    "stall_stop": "study of precision",
}
"""Labels of kinds and levels; the levels of the multiple fault are its two studies."""

# The thesis used its random k7 = 0.8009 as the angle in radians.
_MULTIPLE_FAULT: Final = {
    "friction": 0.0068,
    "backlash": 0.0,
    "short_circuit_a": 9.19e-3,
    "short_circuit_b": 0.0013,
    "short_circuit_c": 8.6e-4,
    "eccentricity": 0.0111,
    "eccentricity_phase": 0.627,
    "gain": 0.38038,
}


@dataclass(frozen=True)
class StudyCase:
    """Fault case of the study."""

    fault: str
    """Kind, one of ``SINGLE_FAULTS`` or ``MULTIPLE``."""
    level: str
    """Level, one of ``LEVELS``; empty for the multiple fault."""
    faults: dict[str, float]
    """Values of the faulty components [-], keyed by name."""

    @property
    def name(self) -> str:
        """Label of kind and level."""
        return f"{self.fault.replace('_', ' ')} {self.level}".strip()

    @property
    def component(self) -> int | None:
        """Index of the faulty component in the fault vector; None for the multiple fault."""
        [name, *further] = self.faults
        return None if further else FAULT_NAMES.index(name)

    @property
    def truth(self) -> NDArray[np.float64]:
        """Fault vector, ``(8,)``."""
        return fault_vector(self.faults)


CASES: Final[dict[str, StudyCase]] = {
    case.name: case
    for case in (
        StudyCase("friction", "low", {"friction": 0.25}),
        StudyCase("friction", "high", {"friction": 0.75}),
        StudyCase("backlash", "low", {"backlash": 9 / 99}),
        StudyCase("backlash", "high", {"backlash": 74 / 99}),
        StudyCase("short_circuit", "low", {"short_circuit_a": 0.2}),
        StudyCase("short_circuit", "high", {"short_circuit_a": 0.7}),
        StudyCase("eccentricity", "low", {"eccentricity": 0.25}),
        StudyCase("eccentricity", "high", {"eccentricity": 0.75}),
        StudyCase("gain", "low", {"gain": 0.25}),
        StudyCase("gain", "high", {"gain": 0.75}),
        StudyCase(MULTIPLE, "", _MULTIPLE_FAULT),
    )
}
"""The cases, keyed by name such as "short circuit low"."""
