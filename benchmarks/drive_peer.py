"""Our field-oriented drive beside motulator's, an independent plant with its own current control.

    tools/peers.sh python benchmarks/drive_peer.py [--json FILE]

Both get the same command and have the same position and speed loops, motor, supply and mechanics
with dry friction; without backlash, as motulator has none. Ours has continuous loops and a mean
inverter. motulator's current control, with two degrees of freedom and without feed-forward of the
back-EMF, is sampled every 50 us, acts a sample later and holds its voltages; its plant is
integrated by scipy's Runge-Kutta. Compared at the samples of our telemetry: the rms difference over
the rms value, in percent, of the current of the axis q and of the speed. Prints a table and writes
JSON; fails where a difference is beyond its limit.

Measured: 1.7 % of the current and 0.08 % of the speed with the built-in motor, 0.4 and 0.05 % with
a larger one. What is left is the delay of the sampled control, 1.5 samples or 75 us, which counts
where the current changes fastest, as the friction reverses, and motulator's friction, which creeps
instead of resting.
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import click
import numpy as np
from motulator.common.control import PWM  # pyright: ignore[reportMissingImports]
from motulator.common.utils import abc2complex  # pyright: ignore[reportMissingImports]
from motulator.drive import model  # pyright: ignore[reportMissingImports]
from motulator.drive.control.sm import CurrentController  # pyright: ignore[reportMissingImports]
from motulator.drive.utils import SynchronousMachinePars  # pyright: ignore[reportMissingImports]
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from ema_core.commands import THESIS_CHIRP
from ema_core.parameters import ActuatorParameters, constants
from ema_sim.actuator import SimulatedActuator

H: Final = 1e-4
"""Sample period of the comparison [s]."""

CONTROL_S: Final = 5e-5
"""Sampling period of motulator's control [s]."""

LIMITS_PERCENT: Final = {"current": 3.0, "speed": 0.5}
"""Largest rms difference over the rms value [%]."""

# Below this speed motulator's dry friction is viscous, as it knows no rest [rad/s].
_SLOW: Final = 0.5

_BUILT_IN: Final = replace(
    ActuatorParameters(), k_t=math.sqrt(3.0) / 2.0 * ActuatorParameters().k_e, BLK=0.0, f_ratio=1.0
)
_LARGE: Final = replace(
    _BUILT_IN,
    V_max=270.0,
    P=4,
    R_s=1.6,
    L_s=4.2e-3,
    k_t=0.2944,
    k_e=0.34,
    I_max=15.0,
    T_max=4.4,
    omega_max=730.0,
    J_m=9e-5,
    J_u=3e-5,
    GAP=0.1,
    G_prop=8e4,
    f_sm=0.1,
    f_su=0.04,
    tau=1.0 / 800.0,
)
PLANTS: Final = {"built-in, 48 V, P = 2": _BUILT_IN, "270 V, P = 4": _LARGE}


class SampledControl:
    """Position and speed loop of ours (M1) with the current control of motulator."""

    def __init__(
        self,
        parameters: ActuatorParameters,
        command: NDArray[np.float64],
        machine: SynchronousMachinePars,
    ) -> None:
        self._p = parameters
        self._command = command
        self._current = CurrentController(machine, parameters.omega_c)
        self._pwm = PWM(overmodulation="MPE")
        self._times = H * np.arange(len(command))
        self._turned = 0.0
        self._last = 0.0
        self.samples: list[tuple[float, float, float]] = []

    def __call__(self, mdl: model.Drive) -> tuple[float, Any]:
        """Measure, and return the sampling period and the duty ratios."""
        p, omega = self._p, mdl.mechanics.meas_speed()
        # The measured angle is that within a turn.
        theta = mdl.mechanics.meas_position()
        self._turned += math.remainder(theta - self._last, 2.0 * math.pi)
        self._last = theta
        electrical = np.exp(1j * p.P * self._turned)
        current = abc2complex(mdl.machine.meas_currents()) / electrical
        self.samples.append((mdl.t0, float(current.imag), omega))
        wanted = p.G_prop * (np.interp(mdl.t0, self._times, self._command) - p.tau * self._turned)
        error = float(np.clip(wanted, -p.omega_max, p.omega_max)) - omega
        I_ref = float(np.clip(p.GAP * error / p.k_t, -p.I_max, p.I_max))
        realized = self._pwm.get_realized_voltage() / electrical
        voltage = self._current.output(1j * I_ref, current) * electrical
        duties = self._pwm(CONTROL_S, voltage, mdl.converter.meas_dc_voltage(), p.P * omega)
        self._current.update(CONTROL_S, realized, p.P * omega)
        return CONTROL_S, duties

    def post_process(self) -> None:
        """Do nothing: motulator calls it at the end."""


def motulators(
    parameters: ActuatorParameters, command: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return current of the axis q and speed at the samples, ``(n,)`` each [A, rad/s]."""
    p = parameters
    mechanics = constants(p).mechanics
    machine = SynchronousMachinePars(
        n_p=p.P,
        R_s=0.5 * p.R_s,
        L_d=0.5 * p.L_s,
        L_q=0.5 * p.L_s,
        psi_f=p.k_e / math.sqrt(3.0) / p.P,
    )

    def friction(speed: Any) -> Any:
        # At last it is called with all speeds at once.
        return mechanics.C + mechanics.f_d / np.maximum(speed, _SLOW)

    drive = model.Drive(
        model.VoltageSourceConverter(u_dc=p.V_max),
        model.SynchronousMachine(machine),
        model.StiffMechanicalSystem(J=mechanics.J, B_L=friction),
    )
    control = SampledControl(p, command, machine)
    model.Simulation(drive, control).simulate(t_stop=H * (len(command) - 1))
    t, current, speed = np.array(control.samples).T
    times = H * np.arange(1, len(command))
    return np.interp(times, t, current), np.interp(times, t, speed)


def measure() -> dict[str, dict[str, float]]:
    """Return the differences by plant [%]."""
    command = THESIS_CHIRP.sample(H)
    found = {}
    for name, parameters in PLANTS.items():
        ours = SimulatedActuator(parameters, sample_period=H, drive="field_oriented")
        telemetry = ours.advance(command)
        # Our current is a mean over the sample: theirs is, too, of its ends.
        current, speed = motulators(parameters, np.concatenate([[0.0], command]))
        mean = (current + np.concatenate([[0.0], current[:-1]])) / 2.0
        found[name] = {
            "current": _difference_percent(mean, telemetry.current),
            "speed": _difference_percent(speed, telemetry.speed),
        }
    return found


def _difference_percent(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    return 100.0 * float(np.sqrt(np.mean((one - other) ** 2) / np.mean(other**2)))


@click.command()
@click.option("--json", "output", type=click.Path(path_type=Path, dir_okay=False))
def main(output: Path | None) -> None:
    """Print the table, write the JSON file, and fail where a difference is too large."""
    found = measure()
    table = Table("plant", "quantity", "rms difference %", "limit %", title="beside motulator")
    for name, row in found.items():
        for quantity, value in row.items():
            table.add_row(name, quantity, f"{value:.2f}", f"{LIMITS_PERCENT[quantity]:g}")
    Console().print(table)
    if output:
        output.write_text(json.dumps(found, indent=1))
    if any(row[name] > limit for row in found.values() for name, limit in LIMITS_PERCENT.items()):
        raise SystemExit("our drive and motulator's differ by more than the limits")


if __name__ == "__main__":
    main()
