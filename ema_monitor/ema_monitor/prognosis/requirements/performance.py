# SPDX-License-Identifier: Apache-2.0
"""Performance of an actuator with faults: tracking error, bandwidth, free play, torque margin.

The fast form of the monitor model (M10) is run for many actuators at a time.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core._jit import kernel
from ema_core.arrays import Array
from ema_core.commands import THESIS_CHIRP, Command
from ema_core.current_loop import current_loop
from ema_core.faults import BACKLASH, FAULTS, HIGHEST, N_FAULTS, degrade, healthy_faults
from ema_core.parameters import (
    ActuatorParameters,
    ControlConstants,
    FieldOrientedParameters,
    MechanicalConstants,
    constants,
)
from ema_core.quantity import check_length
from ema_core.simd import LANES, broadcast, load, select, store
from ema_monitor.model.drives import (
    FastDrive,
    available_current,
    currents_at_rest,
    fast_constants,
    first_stage,
    motor_current,
    next_stage,
)
from ema_monitor.model.field_oriented import FieldOrientedDrive, field_oriented_constants
from ema_monitor.model.kernel import ModelState, advance
from ema_monitor.model.threads import run_in_threads

LONGEST_STEP: Final = 5e-5
"""Longest integration step [s]. Compared with 1 us, it changes no performance by more than 0.5
%."""

HALF_POWER: Final = math.sqrt(0.5)
"""Amplitude ratio at -3 dB [-]."""

_STEP_OF_SPEED_LOOP = 0.1
_ARRAYS = 8  # number of arrays of a command and its phase in memory at a time
_SWEEP_PERIODS = 20
_SWEEP_RANGE = (1.0 / 3.0, 4.0)


@kernel()
def run_test(
    control: ControlConstants,
    drive_of_lanes: FastDrive | FieldOrientedDrive,
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
    """Simulate `LANES` actuators from row ``first`` on, from rest in the middle of their backlash.

    ``command`` is the command at the end of each step, ``delayed_command`` the command half a step
    before the start of the step, both ``(n,)`` [rad]. The results cover the steps between two
    ``edges``, ``(b + 1,)``, and have shape ``(n_lanes, b)``: ``error_peak`` is the largest error of
    the user shaft [rad], ``used_peak`` the largest ratio of the current to the available current
    [-], ``real`` and ``imaginary`` are the sums of the user shaft's angle times ``cos_phase`` and
    ``sin_phase``, both ``(n,)`` [rad].
    """
    c, drive, mech = load(control, first), load(drive_of_lanes, first), load(mechanics, first)
    zero = broadcast(0.0)
    currents, stage = currents_at_rest(drive, zero), first_stage(drive, zero)
    x = ModelState(zero, broadcast(1.0), zero, zero, zero, currents, zero, zero)
    for b in range(len(edges) - 1):
        worst, used, in_phase, in_quadrature = zero, zero, zero, zero
        for k in range(edges[b], edges[b + 1]):
            before = x
            stage = next_stage(drive, stage, before.theta_m)
            x = advance(c, drive, mech, before, stage, False, delayed_command[k], 0.0, mech.f_d, dt)
            I = motor_current(drive, stage, x.I)
            available = available_current(drive, stage, before.cos, before.sin, before.omega, I)
            available = min(available, broadcast(c.I_max))
            used = max(used, select(abs(I) < available, abs(I) / available, 1.0))
            user = x.theta_b * mech.tau
            worst = max(worst, abs(command[k] - user))
            in_phase += user * cos_phase[k]
            in_quadrature += user * sin_phase[k]
        store(real, first, b, in_phase)
        store(imaginary, first, b, in_quadrature)
        store(error_peak, first, b, worst)
        store(used_peak, first, b, used)


class Performance(NamedTuple):
    """Performance of ``m`` actuators, ``(m,)`` each; see ``PerformanceModel`` for definitions."""

    tracking_error: Array
    """Largest tracking error at the user shaft [rad]."""
    bandwidth: Array
    """Bandwidth at -3 dB [Hz]."""
    free_play: Array
    """Free play at the user shaft [rad]."""
    torque_margin: Array
    """Least unused share of the available torque [-]."""


class PerformanceModel:
    """Performance of an actuator, computed by the fast monitor model.

    Parameters
    ----------
    parameters
        Parameters of the unit, `FieldOrientedParameters` for a field-oriented drive;
        ``Calibration.unit_parameters`` if there is a calibration.
    bandwidth_sought
        Expected bandwidth [Hz]: the sweep covers a third to four times this frequency.

    Attributes
    ----------
    dt
        Integration step [s].
    healthy
        Performance of the healthy actuator by name, in the units of `Performance`.

    Raises
    ------
    ValueError
        If the bandwidth is not positive, or the speed loop is so fast that its simulation has
        too many steps.

    Notes
    -----
    *Tracking error*: the largest distance of the user shaft from the thesis's chirp, 5 mrad from
    0 to 15 Hz in 0.5 s, from rest in the middle of the play.

    *Bandwidth*: the loop limits speed, current and voltage and has dry friction and play, so it
    has no transfer function. Its sinusoidal describing function at the amplitude of the test is
    used instead (Gelb and Vander Velde, Multiple-Input Describing Functions and Nonlinear System
    Design, McGraw-Hill 1968): the ratio of the fundamental of the user shaft to the command. The
    bandwidth is the lowest frequency at which this ratio is 1/sqrt(2). A single slow sweep of
    constant amplitude covers all frequencies; the fundamental is taken from each of its periods,
    which differs from the response to steady sines by up to 5 %. The bandwidth is limited to the
    range of the sweep.

    *Free play*: full width of the backlash at the user shaft, BLK (1 + 99 k_2) tau.

    *Torque margin*: 1 minus the largest share of the available torque that the chirp uses at any
    instant. At the present speed and angle of the rotor, the available torque is the least of the
    torque limit, the torque of the driven pair at the current limit, and its torque at the current
    for which the voltage left by the back-EMF suffices, (V_max - K omega) / R. For a field-oriented
    drive, V_max / sqrt(3) and the q axis replace supply and pair. The torque constant of the pair
    cancels: the ratio of the two currents remains. A margin of 0.5 is the motorisation factor of 2
    required for space mechanisms (ECSS-E-ST-33-01C, Mechanisms; as a margin of at least 1 in
    NASA-STD-5017).
    """

    def __init__(self, parameters: ActuatorParameters, bandwidth_sought: float = 12.0) -> None:
        if not 0.0 < bandwidth_sought < math.inf:
            raise ValueError(f"bandwidth_sought = {bandwidth_sought!r} Hz: expected more than 0 Hz")
        self._plant = constants(parameters)
        self._loop = None
        if isinstance(parameters, FieldOrientedParameters):
            self._loop = current_loop(parameters)
        self._width = parameters.BLK * parameters.tau
        fastest = parameters.GAP / self._plant.mechanics.J
        self.dt = min(LONGEST_STEP, _STEP_OF_SPEED_LOOP / max(fastest, 1e-9))
        lowest, highest = (share * bandwidth_sought for share in _SWEEP_RANGE)
        self._sweep = Command(
            amplitude=THESIS_CHIRP.amplitude,
            duration=2.0 * _SWEEP_PERIODS / (lowest + highest),
            start_frequency=lowest,
            end_frequency=highest,
        )
        check_length(
            max(THESIS_CHIRP.duration, self._sweep.duration) / self.dt,
            f"GAP = {parameters.GAP:g} N.m.s/rad with an inertia of {self._plant.mechanics.J:g} "
            f"kg.m^2 requires steps of {self.dt:.3g} s; a sweep around {bandwidth_sought:g} Hz",
            _ARRAYS,
        )
        self._chirp_figures = _Figures(THESIS_CHIRP, self.dt)
        self._sweep_figures = _Figures(self._sweep, self.dt)
        performance = self.performance(healthy_faults())
        self.healthy = {name: float(getattr(performance, name)[0]) for name in performance._fields}

    def performance(self, faults: ArrayLike) -> Performance:
        """Return the performance of actuators with faults.

        Parameters
        ----------
        faults
            Fault vectors, ``(m, 8)``, or a vector, ``(8,)``. Values are clipped to the range of
            their component. The performance is NaN for a vector with a NaN.
        """
        faults = as_faults(faults)
        tracking_error, torque_margin = self.chirp(faults)
        return Performance(
            tracking_error, self.bandwidth(faults), self.free_play(faults), torque_margin
        )

    def chirp(self, faults: ArrayLike) -> tuple[Array, Array]:
        """Return only tracking error [rad] and torque margin [-], ``(m,)`` each."""
        error, used, _ = self._run(self._chirp_figures, as_faults(faults))
        return error.max(axis=1), 1.0 - used.max(axis=1)

    def bandwidth(self, faults: ArrayLike) -> Array:
        """Return only the bandwidth, ``(m,)`` [Hz]."""
        figures = self._sweep_figures
        _, _, fundamental = self._run(figures, as_faults(faults))
        ratio = np.abs(fundamental) / self._sweep.amplitude
        below = ratio < HALF_POWER
        first = np.where(below.any(axis=1), below.argmax(axis=1), ratio.shape[1] - 1)
        rows, before = np.arange(len(ratio)), np.maximum(first - 1, 0)
        high, low = ratio[rows, before], ratio[rows, first]
        drop = np.where(high > low, high - low, np.inf)
        share = np.clip((high - HALF_POWER) / drop, 0.0, 1.0)
        f = figures.frequencies
        bandwidth = f[before] + share * (f[first] - f[before])
        bandwidth = np.where(below.any(axis=1), bandwidth, f[-1])
        return np.where(np.isnan(ratio).any(axis=1), np.nan, bandwidth)

    def free_play(self, faults: ArrayLike) -> Array:
        """Return only the free play, ``(...,)`` [rad], for fault vectors, ``(..., 8)``."""
        backlash = np.asarray(faults, dtype=np.float64)[..., BACKLASH]
        return self._width * FAULTS[BACKLASH].at(np.clip(backlash, 0.0, HIGHEST[BACKLASH]))

    def _run(
        self, figures: "_Figures", faults: Array
    ) -> tuple[Array, Array, NDArray[np.complex128]]:
        rows = np.flatnonzero(np.isfinite(faults).all(axis=1))
        results = np.full((4, len(faults), len(figures.frequencies)), np.nan)
        if rows.size:
            groups = -(-rows.size // LANES)
            # Copies of the last actuator fill the last group.
            lane_of = rows[np.minimum(np.arange(groups * LANES), rows.size - 1)]
            control, motor, mechanics = degrade(self._plant, faults[lane_of])
            if self._loop is None:
                drive = fast_constants(motor, self.dt)
            else:
                drive = field_oriented_constants(motor, self._loop, self.dt)
            of_lanes = np.empty((4, len(lane_of), results.shape[2]))

            def run(group: int) -> None:
                first = group * LANES
                run_test(control, drive, mechanics, first, *figures.signals, self.dt, *of_lanes)

            run_in_threads(run, groups)
            results[:, rows] = of_lanes[:, : rows.size]
        error, used, real, imaginary = results
        return error, used, 2.0 * (real + 1j * imaginary) / np.diff(figures.signals[-1])


class _Figures:
    """A command, its phase at each step, and the steps at which its periods begin."""

    def __init__(self, command: Command, dt: float) -> None:
        n = round(command.duration / dt)
        t = dt * np.arange(1.0, n + 1)
        f0, rate = command.start_frequency, command.end_frequency - command.start_frequency
        rate /= command.duration

        def turns(t: Array) -> Array:
            return t * (f0 + rate * t / 2.0)

        # An Euler step responds half a step too early: the command is read half a step later.
        delayed = 2 * np.pi * turns(np.maximum(t - 1.5 * dt, 0.0))
        phase = 2 * np.pi * turns(t)
        whole = np.arange(math.ceil(turns(t)[-1] - 0.01))
        edges = np.append(np.searchsorted(turns(t), whole), n)
        self.frequencies = f0 + rate * dt * (edges[1:] + edges[:-1]) / 2.0
        # Arguments of `run_test`, from the delayed command to the edges.
        self.signals = (
            command.amplitude * np.sin(delayed),
            command.amplitude * np.sin(phase),
            np.cos(phase),
            np.sin(phase),
            edges,
        )


def as_faults(faults: ArrayLike) -> Array:
    """Return fault vectors, ``(m, 8)``, within their ranges; NaN stays NaN.

    Raises
    ------
    ValueError
        If the vectors do not have eight components.
    """
    array = np.atleast_2d(np.asarray(faults, dtype=np.float64))
    if array.shape[-1] != N_FAULTS:
        raise ValueError(
            f"a fault vector has {N_FAULTS} components: shape {array.shape} is not supported"
        )
    return np.clip(array, 0.0, HIGHEST)
