"""The fault vector: names, ranges, meaning, and what each fault does to an actuator."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.parameters import PlantConstants


@dataclass(frozen=True)
class Fault:
    """One component of the fault vector.

    ``healthy`` is the healthy value of the normalised k, ``highest`` the largest that can be
    simulated. What k means is ``quantity`` = ``base`` + ``slope`` k, in ``unit``.
    """

    name: str
    label: str
    healthy: float
    highest: float
    quantity: str
    base: float
    slope: float
    unit: str

    @property
    def meaning(self) -> str:
        """What the normalised value k means, as a formula."""
        sign = "-" if self.slope < 0.0 else "+"
        factor = "" if abs(self.slope) == 1.0 else f"{abs(self.slope):.4g} "
        formula = f"{self.base:.4g} {sign} {factor}k"
        return f"{self.quantity} = ({formula}) {self.unit}".strip()

    def physical(self, k: float) -> str:
        """Return what a normalised value amounts to, in words."""
        return f"{self.quantity} {self.base + self.slope * k:.3f} {self.unit}".strip()


FAULTS: Final = (
    Fault("friction", "friction", 0.0, 1.0, "dry friction", 1.0, 2.0, "× nominal"),
    Fault("backlash", "backlash", 0.0, 1.0, "backlash", 1.0, 99.0, "× nominal"),
    Fault("short_circuit_a", "short circuit A", 0.0, 0.99, "healthy turns of A", 1.0, -1.0, ""),
    Fault("short_circuit_b", "short circuit B", 0.0, 0.99, "healthy turns of B", 1.0, -1.0, ""),
    Fault("short_circuit_c", "short circuit C", 0.0, 0.99, "healthy turns of C", 1.0, -1.0, ""),
    Fault("eccentricity", "eccentricity", 0.0, 1.0, "eccentricity zeta", 0.0, 1.0, ""),
    Fault(
        "eccentricity_phase",
        "eccentricity phase",
        0.5,
        1.0,
        "direction phi",
        -np.pi,
        2.0 * np.pi,
        "rad",
    ),
    Fault("gain", "gain", 0.5, 1.0, "position-loop gain", 0.5, 1.0, "× nominal"),
)
FAULT_NAMES: Final = tuple(fault.name for fault in FAULTS)
N_FAULTS: Final = len(FAULTS)
HIGHEST: Final = np.array([fault.highest for fault in FAULTS])
SHORT_CIRCUITS: Final = [i for i, name in enumerate(FAULT_NAMES) if name.startswith("short")]
ECCENTRICITY: Final = FAULT_NAMES.index("eccentricity")
ECCENTRICITY_PHASE: Final = FAULT_NAMES.index("eccentricity_phase")


def healthy_faults() -> NDArray[np.float64]:
    """Return the fault vector of a healthy actuator, ``(8,)``."""
    return np.array([fault.healthy for fault in FAULTS])


def fault_vector(values: Mapping[str, float] | ArrayLike) -> NDArray[np.float64]:
    """Return a validated fault vector, or many.

    Parameters
    ----------
    values
        Either names and values, where what is not named is healthy, or all eight values of one
        vector, ``(8,)``, or of many, ``(..., 8)``.

    Returns
    -------
    numpy.ndarray
        A copy of the vector or vectors, ``(..., 8)``.

    Raises
    ------
    ValueError
        When a name is unknown, a value is not finite or outside its range, or eight values were
        expected and not given.
    """
    if isinstance(values, Mapping):
        k = healthy_faults()
        for name, value in values.items():
            if name not in FAULT_NAMES:
                raise ValueError(f"unknown fault {name!r}; known: {', '.join(FAULT_NAMES)}")
            try:
                k[FAULT_NAMES.index(name)] = value
            except (TypeError, ValueError) as error:
                raise ValueError(f"fault {name} = {value!r} is not a number") from error
    else:
        k = np.array(values, dtype=np.float64)
        if k.shape[-1:] != (N_FAULTS,):
            raise ValueError(f"a fault vector has {N_FAULTS} components, not shape {k.shape}")
    bad = np.argwhere(~((k >= 0.0) & (k <= HIGHEST)))
    if bad.size:
        fault = FAULTS[bad[0][-1]]
        raise ValueError(
            f"fault {fault.name} = {k[tuple(bad[0])]:g} is outside [0, {fault.highest:g}] "
            f"({fault.meaning})"
        )
    return k


def degrade(plant: PlantConstants, faults: ArrayLike) -> PlantConstants:
    """Return the constants of a plant with faults; a healthy vector leaves them as they are.

    Parameters
    ----------
    plant
        Constants of the healthy plant.
    faults
        One fault vector, ``(8,)``, or many, ``(n, 8)``: then the constants that faults act on
        have shape ``(n,)``.

    Raises
    ------
    ValueError
        When a vector is not a fault vector.

    Notes
    -----
    Equation M9; section 6.1 of the thesis.
    """
    friction, backlash, short_a, short_b, short_c, zeta, phase, gain = np.moveaxis(
        fault_vector(faults), -1, 0
    )
    return PlantConstants(
        plant.control._replace(G_prop=plant.control.G_prop * (0.5 + gain)),
        plant.motor._replace(
            N_a=plant.motor.N_a * (1.0 - short_a),
            N_b=plant.motor.N_b * (1.0 - short_b),
            N_c=plant.motor.N_c * (1.0 - short_c),
            zeta=plant.motor.zeta + zeta,
            phi=plant.motor.phi + (2.0 * phase - 1.0) * np.pi,
        ),
        plant.mechanics._replace(
            f_s=plant.mechanics.f_s * (1.0 + 2.0 * friction),
            f_d=plant.mechanics.f_d * (1.0 + 2.0 * friction),
            half_backlash=plant.mechanics.half_backlash * (1.0 + 99.0 * backlash),
        ),
    )


def random_faults(rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw a random multiple fault by the thesis's law (its section 7.2).

    Returns
    -------
    numpy.ndarray
        Fault vector, ``(8,)``: most components small, phase uniform, gain about its healthy value.
    """
    r = rng.random(N_FAULTS)
    k = r**7
    k[ECCENTRICITY_PHASE] = r[ECCENTRICITY_PHASE]
    k[-1] = ((2.0 * r[-1] - 1.0) ** 7 + 1.0) / 2.0
    return np.minimum(k, HIGHEST)


def estimation_error(estimate: ArrayLike, truth: ArrayLike) -> float:
    """Return the error of an estimate in percent of the range.

    Parameters
    ----------
    estimate, truth
        Fault vectors, ``(8,)``.

    Notes
    -----
    The form that reproduces the thesis's printed errors (equation M14): the phase counts by the
    estimated eccentricity. The phase difference is wrapped to half a turn.
    """
    k, k_true = np.asarray(estimate, dtype=float), np.asarray(truth, dtype=float)
    difference = k - k_true
    turn = difference[ECCENTRICITY_PHASE]
    difference[ECCENTRICITY_PHASE] = k[ECCENTRICITY] * (turn - np.round(turn))
    return float(100.0 * np.sqrt(np.sum(difference**2)))
