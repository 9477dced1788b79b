# SPDX-License-Identifier: Apache-2.0
"""The yardstick's form of the model in the lanes of the monitor's kernels, with the same steps.

It separates the speed of the lanes from the additional work of the released pair form: two more
constants per pair, the lift of the idle phase, end stops and the speed.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core._jit import kernel
from ema_core.simd import LANES, broadcast, load, select, store

STEP_S: Final = 1e-5
DECIMATION: Final = 10
_PAIR: Final = 2.0 * math.pi / 3.0
_ZETA: Final = 0.3


class Individuals(NamedTuple):
    """Parameters that differ between the individuals of the yardstick, ``(n,)`` each."""

    F_s: NDArray[np.float64]
    N_a: NDArray[np.float64]
    slew: NDArray[np.float64]


def individuals() -> Individuals:
    """Return the yardstick's sixteen individuals."""
    friction = np.arange(LANES) / (LANES - 1.0)
    N_a = np.full(LANES, 0.8)
    return Individuals(
        0.1689 * (1.0 + 2.0 * friction),
        N_a,
        np.full(LANES, STEP_S / (7.2e-4 * (0.8**2 + 2.0) / 3.0)),
    )


def command() -> NDArray[np.float64]:
    """Return the yardstick's chirp, one value per step, ``(50000,)`` [rad]."""
    t = STEP_S * np.arange(50_000)
    return 0.005 * np.sin(2.0 * math.pi * 15.0 / (2.0 * 0.5) * t * t)


@kernel()
def run(lanes: Individuals, com, dt, current):
    """Simulate all individuals and fill their ``current``, ``(LANES, n / DECIMATION)`` [A].

    ``com`` is the command, ``(n,)`` [rad], ``dt`` the step [s].
    """
    q = load(lanes, 0)
    k_e, R_s, V, G_M = 0.0752, 2.13, 48.0, 0.07322
    C = 30.0 / math.pi * 1e-6 + 4.5e-7
    omega_max = 8000.0 * 2.0 * math.pi / 60.0
    gain, dj = 0.05 / 0.0752, dt / 2.5e-5
    F_d = 0.5 * q.F_s
    lag = 1.0 - math.exp(-dt / 1e-5)
    cos_b, sin_b = _ZETA * math.cos(_PAIR), _ZETA * math.sin(_PAIR)
    cos_c, sin_c = _ZETA * math.cos(2.0 * _PAIR), _ZETA * math.sin(2.0 * _PAIR)
    I, w, bl, theta, s = (
        broadcast(0.0),
        broadcast(0.0),
        broadcast(0.0),
        broadcast(0.0),
        broadcast(0.0),
    )
    f1, f2, f3 = broadcast(0.0), broadcast(0.0), broadcast(0.0)
    c, x = broadcast(1.0), broadcast(1.0 / 6.0)
    for j in range(current.shape[1]):
        total = broadcast(0.0)
        for i in range(DECIMATION):
            w_ref = min(max(1e5 * (com[j * DECIMATION + i] - bl / 500.0), -omega_max), omega_max)
            I_ref = min(max(gain * (w_ref - w), -22.5), 22.5)
            n_a = select(x >= 1.0 / 3.0, q.N_a, 0.0)
            n_b = select(x < 2.0 / 3.0, 1.0, 0.0)
            n_c = select((x < 1.0 / 3.0) | (x >= 2.0 / 3.0), 1.0, 0.0)
            f = 0.5 * (n_a + n_b + n_c)
            K = f + 0.5 * (
                n_a * (_ZETA * c) + n_b * (cos_b * c - sin_b * s) + n_c * (cos_c * c - sin_c * s)
            )
            e = -k_e * K * w - R_s * f * I
            I = I + min(max(I_ref - I, q.slew * (e - V)), q.slew * (V + e))
            torque = min(max(G_M * K * I, -1.689), 1.689)
            f1 += lag * (I - f1)
            f2 += lag * (f1 - f2)
            f3 += lag * (f2 - f3)
            net = torque - C * w
            rests = w == 0.0
            friction = select(select(rests, net, w) > 0.0, F_d, -F_d)
            moved = w + dj * (net - friction)
            stops = (rests & (abs(net) <= q.F_s)) | (moved * w < 0.0)
            w = select(stops, 0.0, moved)
            turn = dt * w
            theta += turn
            x += turn * (2.0 / math.pi)
            x = select(x >= 1.0, x - 1.0, x)
            x = select(x < 0.0, x + 1.0, x)
            near = 1.0 - 0.5 * turn * turn
            c, s = c * near - s * turn, s * near + c * turn
            bl = min(max(bl, theta - 0.0025), theta + 0.0025)
            total += f3
        store(current, 0, j, total * (1.0 / DECIMATION))
