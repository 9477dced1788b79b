# SPDX-License-Identifier: Apache-2.0
"""Registry of the quantities of a record that is compared with healthy records."""

from collections.abc import Mapping
from typing import Final, NamedTuple


class Quantity(NamedTuple):
    """A physical quantity of a joint."""

    label: str
    """Displayed name."""
    reference: str = "healthy"
    """Reference of a relative change."""


FRICTION: Final = "friction"
VISCOUS: Final = "viscous_friction"
TORQUE: Final = "torque_per_ampere"
INERTIA: Final = "inertia"
FRICTION_OVER_INERTIA: Final = "friction_over_inertia"
GRAVITY: Final = "gravity"
LOAD: Final = "load"
PLAY: Final = "play"
TRACKING: Final = "tracking_lag"

QUANTITIES: Final[Mapping[str, Quantity]] = {
    FRICTION: Quantity("Coulomb friction"),
    VISCOUS: Quantity("viscous friction", reference="all friction at the usual speed"),
    TORQUE: Quantity("torque per unit of effort"),
    INERTIA: Quantity("inertia"),
    FRICTION_OVER_INERTIA: Quantity("Coulomb friction over inertia"),
    GRAVITY: Quantity("gravity"),
    LOAD: Quantity("constant load"),
    PLAY: Quantity("play"),
    TRACKING: Quantity("tracking lag"),
}
"""The quantities of a comparison by name, in display order."""

FAULTS_OF_RECORDS: Final[Mapping[str, str]] = {FRICTION: "friction", PLAY: "backlash"}
"""Fault that each quantity measures. Records of an unknown drive do not measure other faults."""
