# SPDX-License-Identifier: Apache-2.0
"""Gains of the current loops in a field-oriented drive, computed from nominal data."""

import math
from typing import Final, NamedTuple

from ema_core.parameters import ActuatorParameters

LINEAR_RANGE: Final = 1.0 / math.sqrt(3.0)
"""Largest ratio of phase voltage amplitude to supply voltage with space-vector modulation [-]."""


class CurrentLoop(NamedTuple):
    """Per-phase constants of both current loops, for kernels (equation M33).

    ``K_p`` [ohm] and ``K_i`` [ohm/s] are the gains, ``L`` [H] and ``k`` [V.s/rad] inductance and
    back-EMF constant of the decoupling, ``P`` the pole pairs [-].
    """

    K_p: float
    K_i: float
    L: float
    k: float
    P: float


def current_loop(parameters: ActuatorParameters) -> CurrentLoop:
    """Return the constants of the current loops for the bandwidth ``omega_c`` (M33)."""
    p = parameters
    R, L = 0.5 * p.R_s, 0.5 * p.L_s
    return CurrentLoop(p.omega_c * L, p.omega_c * R, L, p.k_e / math.sqrt(3.0), float(p.P))
