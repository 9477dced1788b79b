# SPDX-License-Identifier: Apache-2.0
"""Monitor model: simulates the response of a faulty actuator to the command of a window."""

from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ema_core.acquisition import Acquisition
from ema_core.arrays import Array
from ema_core.current_loop import current_loop
from ema_core.faults import degrade, healthy_faults
from ema_core.parameters import ActuatorParameters, constants
from ema_core.quantity import check_length
from ema_core.telemetry import Telemetry
from ema_monitor.model.deviations import (
    N_SENSOR,
    Deviations,
    deviating,
    sensed,
    with_unit_eccentricity,
)
from ema_monitor.model.threads import run_in_threads
from ema_monitor.windows.window import Window

FORMS: Final = {"fast": 2e-5, "source": 1e-6, "field_oriented": 1e-5}
"""Forms of the model and their default integration step [s].

The field-oriented form needs a shorter step than the fast form, because it has no PWM ripple that
would exceed the integration error.
"""

FORMS_OF_DRIVES: Final = {"six_step": ("fast", "source"), "field_oriented": ("field_oriented",)}
"""Available forms by drive; the first form is the default."""

LEARNS_UNIT: Final = ("fast", "field_oriented")
"""Forms that support deviations of the unit and hidden causes."""


class Response(NamedTuple):
    """Samples of current and speed, ``(m, n)`` each [A, rad/s].

    The current is sampled as in the telemetry. The speed is the motor speed at the end of a sample.
    If the telemetry has no speed, it is the speed of the fast shaft behind the play, averaged over
    the sample, because this speed can be derived from a measured position.
    """

    current: Array
    speed: Array


class MonitorModel:
    """One-phase model of an actuator that follows the measured command of a window.

    The numbers (M10), (M11) and (M35) refer to equations in ``docs/model.md``.

    Parameters
    ----------
    parameters
        Nominal parameters of the actuator.
    form
        "fast", the slew-limited current of the driven pair (M10); "source", the sign-switched
        current of the thesis with its eq. 4.24 (M11); or "field_oriented", the q axis of a
        sinusoidal motor (M35).
    dt
        Integration step [s]; None for the default step of the form.
    unit
        Deviations of the unit from the parameters; None for the nominal actuator. ``lift`` has an
        effect in the fast form only.
    acquisition
        Acquisition of the telemetry; by default the current is averaged and all columns are
        measured.

    Raises
    ------
    ValueError
        If the form is unknown, or the step is not positive or too long.
    """

    def __init__(
        self,
        parameters: ActuatorParameters,
        form: str = "fast",
        dt: float | None = None,
        unit: Deviations | None = None,
        acquisition: Acquisition | None = None,
    ) -> None:
        if form not in FORMS:
            raise ValueError(f"monitor form {form!r} is unknown; known: {', '.join(FORMS)}")
        self.parameters = parameters
        self.form = form
        self.dt = FORMS[form] if dt is None else float(dt)
        if not 0.0 < self.dt <= 1e-3:
            raise ValueError(f"monitor step dt = {self.dt:g} s is outside (0, 0.001] s")
        self.unit = unit or Deviations()
        self.acquisition = acquisition or Acquisition()
        self._deviations, self._plant = np.array(self.unit), constants(parameters)
        self._loop = current_loop(parameters)

    def respond(
        self,
        window: Window,
        faults: ArrayLike,
        play: ArrayLike | float = 0.0,
        corrections: Response | None = None,
        deviations: Array | None = None,
        position: ArrayLike | None = None,
    ) -> Response:
        """Return the simulated equivalent current and motor speed of each individual.

        Parameters
        ----------
        window
            Window with the command and initial state, ``n`` samples after the start.
        faults
            Fault vectors of the individuals, ``(m, 8)``.
        play
            Initial position of the motor within the backlash, ``(m,)`` or one value for all
            [half-widths, -1 to 1].
        corrections
            Values added to current and speed of all individuals, ``(n,)`` each; None for zeros.
        deviations
            Deviations of each individual from the unit, ``(m, 25)``; None for no deviation.
        position
            Initial position of the user shaft, ``(m,)`` or one value for all [rad]; None for the
            measured position.

        Raises
        ------
        ValueError
            If the sample period of the window is not a whole multiple of the step, a fault vector
            is out of range, or the response would take too much memory.
        """
        # Imported here: an unknown drive needs no response, and therefore no compiler.
        from ema_core.dynamics import current_sampling, lag_factor
        from ema_core.simd import LANES
        from ema_monitor.model.drives import fast_constants, source_constants
        from ema_monitor.model.field_oriented import field_oriented_constants
        from ema_monitor.model.kernel import ShaftConstants, run_lanes

        faults = np.atleast_2d(np.asarray(faults, dtype=np.float64))
        m = len(faults)
        groups = -(-m // LANES)
        check_length(
            groups * LANES * float(len(window)),
            f"the responses of {m} individuals in a window of {len(window)} samples",
            2,
        )
        # Copies of the last individual fill the last group.
        lane_of = np.minimum(np.arange(groups * LANES), m - 1)
        added = (np.zeros((m, 1)) if deviations is None else deviations)[lane_of]
        rows = self._deviations + added
        d = Deviations(*rows.T.copy())  # pyright: ignore[reportArgumentType]
        plant = degrade(self._plant, with_unit_eccentricity(faults[lane_of], rows))
        control, motor, mechanics = deviating(plant, rows)
        shaft = ShaftConstants(d.load_torque, d.load_stiffness, d.stribeck_speed)
        if self.form == "fast":
            drive = fast_constants(motor, self.dt, d.lift, d.loop_delay)
        elif self.form == "source":
            drive = source_constants(motor, self.dt)
        else:
            drive = field_oriented_constants(motor, self._loop, self.dt, d.loop_delay)
        steps, lag = self.steps(window.sample_period), lag_factor(self.dt)
        sampling = current_sampling(self.acquisition, steps, self.dt)
        speed_loop = True if self.parameters.GAI or self.parameters.GAD else None
        play_of_lane = np.full(m, play, dtype=np.float64)[lane_of]
        first = float(window.telemetry.position[0]) if position is None else position
        first_of_lane = np.full(m, first, dtype=np.float64)[lane_of]
        response = Response(*np.empty((2, len(lane_of), len(window))))
        sensor_errors = rows[:m, -N_SENSOR:]
        has_sensor_errors = bool(np.any(sensor_errors))
        if corrections is None:
            corrections = Response(*np.zeros((2, len(window))))
        # Corrections must be added after sensor errors, so that the kernel adds zeros here.
        of_kernel = Response(*np.zeros((2, len(window)))) if has_sensor_errors else corrections

        def run(group: int) -> None:
            run_lanes(
                control,
                drive,
                mechanics,
                shaft,
                play_of_lane,
                group * LANES,
                window.command,
                first_of_lane,
                window.initial_speed(self.parameters.tau),
                window.initial_current,
                speed_loop,
                steps,
                self.dt,
                lag,
                sampling,
                not self.acquisition.speed,
                of_kernel,
                response,
            )

        run_in_threads(run, groups)
        motion = Response(response.current[:m], response.speed[:m])
        if not has_sensor_errors:
            return motion
        readings = sensed(motion, sensor_errors, window.sample_period)
        return Response(
            *(row + correction for row, correction in zip(readings, corrections, strict=True))
        )

    def of_unit(self, unit: Deviations) -> "MonitorModel":
        """Return a copy of the model with other deviations of the unit."""
        return MonitorModel(self.parameters, self.form, self.dt, unit, self.acquisition)

    def steps(self, sample_period: float) -> int:
        """Return the number of integration steps per sample of the telemetry.

        Raises
        ------
        ValueError
            If the sample period is not a whole multiple of the step.
        """
        steps = round(sample_period / self.dt)
        if steps < 1 or abs(steps * self.dt - sample_period) > 1e-6 * sample_period:
            raise ValueError(
                f"sample period {sample_period:g} s is not a whole multiple of the monitor's "
                f"step dt = {self.dt:g} s"
            )
        return steps


def form_of(drive: str, form: str | None = None) -> str:
    """Return the requested form of the model for a drive, or the default if ``form`` is None.

    Raises
    ------
    ValueError
        If there is no model of the drive, or the form is not available for it.
    """
    available = FORMS_OF_DRIVES.get(drive)
    if available is None:
        raise ValueError(
            f"no monitor model for drive {drive!r}; expected {' or '.join(FORMS_OF_DRIVES)}"
        )
    if form is not None and form not in available:
        raise ValueError(
            f"monitor form {form!r} is not available for drive {drive!r}; expected "
            f"{' or '.join(available)}"
        )
    return form or available[0]


def compile_kernels(forms: Iterable[str] = FORMS) -> None:
    """Compile the kernels of model forms before their first use, or load them from the cache."""
    zeros = np.zeros(2)
    at_rest = Telemetry(0, 1e-4, 1, command=zeros, current=zeros, position=zeros, speed=zeros)
    for form in FORMS.keys() & set(forms):
        MonitorModel(ActuatorParameters(), form).respond(Window(at_rest), healthy_faults())
