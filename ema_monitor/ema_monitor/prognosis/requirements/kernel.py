"""Kernels of the performance test: figures of merit of the fast form under a command.

The model starts at rest; figures of merit are kept instead of samples. The equation numbers are
those of ``docs/model.md``.
"""

import math

from ema_core._jit import kernel
from ema_core.parameters import ControlConstants, MechanicalConstants
from ema_core.simd import LANES, broadcast, load, select, store
from ema_monitor.model.drives import FastDrive, of_pair, pair_position
from ema_monitor.model.kernel import ModelState, advance


@kernel()
def available_current(drive: FastDrive, x: ModelState, I, I_max):
    """Return the largest current of the driven pair in the direction of ``I`` [A].

    It is limited by the current limit, by the torque limit and by the voltage that the back-EMF
    leaves.
    """
    position = pair_position(drive.half_turns * x.theta_m)
    K = of_pair(position, drive.K)
    K += of_pair(position, drive.K_cos) * x.cos + of_pair(position, drive.K_sin) * x.sin
    voltage = drive.V_max - math.copysign(K, I) * x.omega
    of_voltage = max(voltage / of_pair(position, drive.R), 0.0)
    return min(min(of_voltage, drive.T_max / abs(K)), broadcast(I_max))


@kernel()
def run_test(
    control: ControlConstants,
    drive_of_lanes: FastDrive,
    mechanics: MechanicalConstants,
    first,
    delayed_command,
    command,
    cos_phase,
    sin_phase,
    edges,
    dt,
    error_peak,
    used_peak,
    real,
    imaginary,
):
    """Run `LANES` actuators from row ``first`` on, from rest in the middle of their backlash.

    ``command`` is the command at the end of each step, ``delayed_command`` that half a step before
    its start, both ``(n,)`` [rad]. The results cover the steps between two ``edges``, ``(b + 1,)``,
    and have shape ``(n_lanes, b)``: ``error_peak`` is the largest error of the user shaft [rad],
    ``used_peak`` the largest ratio of the current to the available current [-], ``real`` and
    ``imaginary`` are the sums of the user shaft's angle times ``cos_phase`` and ``sin_phase``,
    both ``(n,)`` [rad].
    """
    c, drive, mech = load(control, first), load(drive_of_lanes, first), load(mechanics, first)
    zero = broadcast(0.0)
    x = ModelState(zero, broadcast(1.0), zero, zero, zero, zero, zero, zero)
    for b in range(len(edges) - 1):
        worst, used, in_phase, in_quadrature = zero, zero, zero, zero
        for k in range(edges[b], edges[b + 1]):
            before = x
            x = advance(c, drive, mech, before, False, delayed_command[k], dt)
            available = available_current(drive, before, x.I, c.I_max)
            used = max(used, select(abs(x.I) < available, abs(x.I) / available, 1.0))
            user = x.theta_b * mech.tau
            worst = max(worst, abs(command[k] - user))
            in_phase += user * cos_phase[k]
            in_quadrature += user * sin_phase[k]
        store(real, first, b, in_phase)
        store(imaginary, first, b, in_quadrature)
        store(error_peak, first, b, worst)
        store(used_peak, first, b, used)


@kernel()
def evaluate_surrogate(points, weights, known, known_weights, per_length, values):
    """Evaluate a cubic trend and a kriging correction at points, `LANES` at a time.

    ``points`` are ``(9, m)`` with ones in the first row; ``weights`` belong to the products of
    three rows. ``known`` points are ``(k, 9)``, in the same coordinates, with ``known_weights``.
    The results are stored in ``values``, ``(m, 1)``; m is a multiple of `ema_core.simd.LANES`. The
    correlation is the rational quadratic (1 + d^2 / 8)^-4, which needs no exponential, at the
    distance d in correlation lengths; ``per_length`` is the inverse of that length.
    """
    width = points.shape[0]
    for first in range(0, points.shape[1], LANES):
        total = broadcast(0.0)
        c = 0
        for i in range(width):
            of_i = broadcast(0.0)
            for j in range(i, width):
                of_j = broadcast(0.0)
                for k in range(j, width):
                    of_j += weights[c] * load(points[k], first)
                    c += 1
                of_i += of_j * load(points[j], first)
            total += of_i * load(points[i], first)
        for p in range(known.shape[0]):
            squares = broadcast(0.0)
            for i in range(1, width):
                difference = load(points[i], first) - known[p, i]
                squares += difference * difference
            nearness = 1.0 / (1.0 + 0.125 * per_length * per_length * squares)
            nearness *= nearness
            total += known_weights[p] * nearness * nearness
        store(values, first, 0, total)
