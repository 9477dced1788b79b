"""Kernel of the performance test: what the fast form of the monitor does under a command.

It advances the model of `ema_monitor.model_kernel` from rest, but keeps figures of merit instead of
samples; the equation numbers are those of ``docs/model.md``.
"""

import math

from ema_core._jit import kernel
from ema_core.parameters import ControlConstants, MechanicalConstants
from ema_core.simd import LANES, broadcast, load, select, store
from ema_monitor.drives import FastDrive, of_pair, pair_position
from ema_monitor.model_kernel import ModelState, advance


@kernel()
def available_current(drive: FastDrive, x: ModelState, I, I_max):
    """Return the current that the driven pair could carry in the direction of ``I`` [A].

    The least of what the limit of the current, that of the torque and the voltage left by the
    back-EMF allow.
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
    heard,
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
    """Run the actuators from ``first`` on, one a lane, from rest in the middle of their play.

    ``command`` is that at the end of each step, ``heard`` that half a step before its start, both
    ``(n,)`` [rad]. Written are, ``(n_lanes, 1)`` each, the largest error of the user shaft [rad]
    and the largest share of the available torque in use [-], and, ``(n_lanes, b)`` each, the user
    shaft's angle times ``cos_phase`` and ``sin_phase`` ``(n,)``, summed over the steps between two
    ``edges`` ``(b + 1,)`` [rad].
    """
    c, drive, mech = load(control, first), load(drive_of_lanes, first), load(mechanics, first)
    zero = broadcast(0.0)
    x = ModelState(zero, broadcast(1.0), zero, zero, zero, zero, zero, zero)
    for b in range(len(edges) - 1):
        worst, used, in_phase, in_quadrature = zero, zero, zero, zero
        for k in range(edges[b], edges[b + 1]):
            before = x
            x = advance(c, drive, mech, before, False, heard[k], dt)
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
def run_stand_in(points, weights, known, known_weights, per_length, values):
    """Evaluate a cubic trend and a kriged correction at points, many lanes at a time.

    ``points`` are ``(9, m)``, the first row ones, with ``weights`` of the products of three of
    the rows; ``known`` are ``(k, 9)``, in the same coordinates, with ``known_weights``. Written are
    ``values``, ``(m, 1)``; m is a whole number of `ema_core.simd.LANES`. The correlation is the
    rational quadratic (1 + d^2 / 8)^-4, which needs no exponential, with d in correlation lengths,
    ``per_length`` to the unit.
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
