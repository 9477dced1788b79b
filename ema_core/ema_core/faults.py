# SPDX-License-Identifier: Apache-2.0
"""Registry of faults: definition, range, limit, typical growth and effect of each fault.

Bounds, health limits, parameters, approach travel, prior laws, uncertainty and documents derive
from ``FAULTS``. CONTRIBUTING.md lists the steps to add a fault.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, make_dataclass
from enum import IntEnum
from types import MappingProxyType
from typing import Any, Final, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.growth_laws import TypicalGrowth
from ema_core.parameters import PlantConstants
from ema_core.wording import unknown_name


class Damage(IntEnum):
    """Measure of use by which the growth of a fault is counted."""

    WEAR = 0
    """Travel, weighted by the load."""
    AGEING = 1
    """Hours, weighted by the temperature of the winding."""
    HOURS = 2
    """Hours in service."""


@dataclass(frozen=True)
class Fault:
    """One component of the fault vector.

    Raises
    ------
    ValueError
        If only some of ``limit``, ``growth`` and ``damage`` are set.
    """

    name: str
    """Name in code, messages and parameters."""
    label: str
    """Displayed name."""
    kind: str
    """Kind of fault, which determines limit and law; the short circuits of all phases share one."""
    healthy: float
    """Healthy value of the normalised k [-]."""
    highest: float
    """Largest normalised value k in simulations [-]."""
    quantity: str
    """Physical quantity: ``base`` + ``slope`` k, in ``unit``."""
    base: float
    slope: float
    unit: str
    mismatch: float
    """Minimum standard deviation that model mismatch adds to an estimate [-]. For eccentricity and
    its phase it applies in their plane."""
    limit: float | None = None
    """Default distance from healthy at which life ends [-]; None for a direction, which is not a
    fault and is neither assessed nor tracked."""
    growth: TypicalGrowth | None = None
    """Typical growth; None without a limit."""
    damage: Damage | None = None
    """Measure of use by which its growth is counted; None without a limit."""
    shown_by: str = ""
    """Phrase for the motion that shows the fault; "" without a limit."""

    def __post_init__(self) -> None:
        values = {"limit": self.limit, "growth": self.growth, "damage": self.damage}
        missing = [name for name, value in values.items() if value is None]
        if 0 < len(missing) < len(values):
            raise ValueError(
                f"fault {self.name}: {' and '.join(missing)} missing: set all of "
                f"{', '.join(values)}, or none for a direction"
            )

    @property
    def is_two_sided(self) -> bool:
        """Whether the fault can differ from its healthy value in both directions."""
        return 0.0 < self.healthy < self.highest

    @property
    def meaning(self) -> str:
        """Formula of the physical value of k."""
        sign = "-" if self.slope < 0.0 else "+"
        factor = "" if abs(self.slope) == 1.0 else f"{abs(self.slope):.4g} "
        formula = f"{self.base:.4g} {sign} {factor}k"
        return f"{self.quantity} = ({formula}) {self.unit}".strip()

    def at(self, k: Any) -> Any:
        """Return the physical values, in ``unit``, of normalised values of any shape."""
        return self.base + self.slope * k

    def physical(self, k: float) -> str:
        """Return the physical value of k as a string, with quantity and unit."""
        return f"{self.quantity} {self.at(k):.3f} {self.unit}".strip()


def _short_circuit(phase: str) -> Fault:
    return Fault(
        name=f"short_circuit_{phase.lower()}",
        label=f"short circuit {phase}",
        kind="short_circuit",
        healthy=0.0,
        highest=0.99,
        quantity=f"healthy turns of {phase}",
        base=1.0,
        slope=-1.0,
        unit="",
        mismatch=1e-3,
        limit=0.25,
        growth=TypicalGrowth("self_heating", 1.5e-4, 6.0, latest_onset=400.0),
        damage=Damage.AGEING,
        shown_by="quick back-and-forth motion, such as a test cycle",
    )


FAULTS: Final = (
    Fault(
        name="friction",
        label="friction",
        kind="friction",
        healthy=0.0,
        highest=1.0,
        quantity="dry friction",
        base=1.0,
        slope=2.0,
        unit="× nominal",
        mismatch=7e-4,
        limit=0.5,
        growth=TypicalGrowth("exponential", 2e-3, 0.05),
        damage=Damage.WEAR,
        shown_by="quick back-and-forth motion, such as a test cycle",
    ),
    Fault(
        name="backlash",
        label="backlash",
        kind="backlash",
        healthy=0.0,
        highest=1.0,
        quantity="backlash",
        base=1.0,
        slope=99.0,
        unit="× nominal",
        mismatch=1.1e-3,
        limit=0.5,
        growth=TypicalGrowth("archard", 3e-4, 3.0),
        damage=Damage.WEAR,
        shown_by="motion that reverses",
    ),
    _short_circuit("A"),
    _short_circuit("B"),
    _short_circuit("C"),
    Fault(
        name="eccentricity",
        label="eccentricity",
        kind="eccentricity",
        healthy=0.0,
        highest=1.0,
        quantity="eccentricity zeta",
        base=0.0,
        slope=1.0,
        unit="",
        mismatch=7e-4,
        limit=0.6,
        growth=TypicalGrowth("power", 1500.0, 1.6),
        damage=Damage.HOURS,
        shown_by="motion over several turns of the motor",
    ),
    Fault(
        name="eccentricity_phase",
        label="eccentricity phase",
        kind="eccentricity_phase",
        healthy=0.5,
        highest=1.0,
        quantity="direction phi",
        base=-np.pi,
        slope=2.0 * np.pi,
        unit="rad",
        mismatch=7e-4,
    ),
    Fault(
        name="gain",
        label="gain",
        kind="gain",
        healthy=0.5,
        highest=1.0,
        quantity="position-loop gain",
        base=0.5,
        slope=1.0,
        unit="× nominal",
        mismatch=3e-4,
        limit=0.25,
        growth=TypicalGrowth("drift", 2.3e-4, diffusion=1e-3),
        damage=Damage.HOURS,
        shown_by="motion of changing speed",
    ),
)
"""Components of the fault vector, in order.

With these laws, parameters and limits, the median life is 100 to 119 tests at intervals of ten
hours. With c = 2000 h for eccentricity and a = 1.5e-4 /h for the gain, 14 % and 27 % of the lives
would exceed 200 tests.
"""

FAULT_BY_NAME: Final = {fault.name: fault for fault in FAULTS}


class FaultVector(NamedTuple):
    """Normalised values of the fault components [-], in the order of ``FAULTS``.

    ``numpy.asarray`` converts it to an array of shape ``(8,)``.
    """

    friction: float
    backlash: float
    short_circuit_a: float
    short_circuit_b: float
    short_circuit_c: float
    eccentricity: float
    eccentricity_phase: float
    gain: float

    @classmethod
    def of(cls, values: ArrayLike) -> Self:
        """Return the fault vector with eight given values, ``(8,)``, without validation."""
        return cls(*np.asarray(values, dtype=np.float64).tolist())


FAULT_NAMES: Final = FaultVector._fields
N_FAULTS: Final = len(FAULTS)
HIGHEST: Final = np.array([fault.highest for fault in FAULTS])
_BASES: Final = np.array([fault.base for fault in FAULTS])
_SLOPES: Final = np.array([fault.slope for fault in FAULTS])
SHORT_CIRCUITS: Final = [i for i, fault in enumerate(FAULTS) if fault.kind == "short_circuit"]
FRICTION: Final = FAULT_NAMES.index("friction")
BACKLASH: Final = FAULT_NAMES.index("backlash")
ECCENTRICITY: Final = FAULT_NAMES.index("eccentricity")
ECCENTRICITY_PHASE: Final = FAULT_NAMES.index("eccentricity_phase")
GAIN: Final = FAULT_NAMES.index("gain")

COMPONENTS: Final = tuple(fault.name for fault in FAULTS if fault.limit is not None)
"""Components that are assessed and tracked: all except the direction of eccentricity."""

INDICES: Final = [FAULT_NAMES.index(name) for name in COMPONENTS]
"""Indices of ``COMPONENTS`` in a fault vector."""

KINDS: Final[Mapping[str, tuple[Fault, ...]]] = MappingProxyType(
    {
        kind: tuple(fault for fault in FAULTS if fault.kind == kind)
        for kind in dict.fromkeys(fault.kind for fault in FAULTS if fault.limit is not None)
    }
)
"""Components by kind of fault."""

LIMITS: Final[Mapping[str, float]] = MappingProxyType(
    {fault.kind: fault.limit for fault in FAULTS if fault.limit is not None}
)
"""Default distance from healthy at which life ends, by kind of fault [-]."""

TYPICAL: Final[Mapping[str, TypicalGrowth]] = MappingProxyType(
    {fault.kind: fault.growth for fault in FAULTS if fault.growth is not None}
)
"""Typical growth by kind of fault; the gain drifts in either direction."""


def kind_of(component: str) -> str:
    """Return the kind of fault of a component of the fault vector."""
    return FAULTS[FAULT_NAMES.index(component)].kind


def settings_by_kind(name: str, annotation: type, make: Callable[[str], Any]) -> Any:
    """Return a frozen dataclass with one field per kind of fault, as a base class of settings.

    ``make`` returns the dataclass field for a kind, ``annotation`` is the type of all fields.
    """
    rows = [(kind, annotation, make(kind)) for kind in KINDS]
    return make_dataclass(name, rows, frozen=True)


def healthy_faults() -> NDArray[np.float64]:
    """Return the fault vector of a healthy actuator, ``(8,)``."""
    return np.array([fault.healthy for fault in FAULTS])


def fault_vector(values: Mapping[str, float] | ArrayLike) -> NDArray[np.float64]:
    """Return fault vectors as an array, after validation.

    Parameters
    ----------
    values
        Values keyed by name (missing names are healthy), or complete vectors, ``(8,)`` or
        ``(..., 8)``.

    Returns
    -------
    numpy.ndarray
        Copy of the vectors, ``(..., 8)``.

    Raises
    ------
    ValueError
        If a name is unknown, a value is not finite or outside its range, or the last dimension
        is not 8.
    """
    if isinstance(values, Mapping):
        k = healthy_faults()
        for name, value in values.items():
            if name not in FAULT_NAMES:
                raise ValueError(unknown_name("fault", name, FAULT_NAMES))
            try:
                k[FAULT_NAMES.index(name)] = value
            except (TypeError, ValueError) as error:
                raise ValueError(f"fault {name} = {value!r} is not a number") from error
    else:
        k = np.array(values, dtype=np.float64)
        if k.shape[-1:] != (N_FAULTS,):
            raise ValueError(
                f"a fault vector has {N_FAULTS} components: shape {k.shape} is not supported"
            )
    bad = np.argwhere(~((k >= 0.0) & (k <= HIGHEST)))
    if bad.size:
        fault = FAULTS[bad[0][-1]]
        raise ValueError(
            f"fault {fault.name} = {k[tuple(bad[0])]:g} is outside [0, {fault.highest:g}] "
            f"({fault.meaning})"
        )
    return k


def eccentricity_angle(phase: Any) -> Any:
    """Return the directions phi [rad] of normalised eccentricity phases, of any shape."""
    return (2.0 * phase - 1.0) * np.pi


def eccentricity_vector(faults: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the eccentricity as Cartesian components, ``zeta cos(phi)`` and ``zeta sin(phi)``.

    Parameters
    ----------
    faults
        One fault vector, ``(8,)``, or several, ``(m, 8)``.

    Returns
    -------
    numpy.ndarray
        ``(2,)`` or ``(2, m)``; smooth where the eccentricity is 0 and its phase undefined.
    """
    phi = eccentricity_angle(faults[..., ECCENTRICITY_PHASE])
    return faults[..., ECCENTRICITY] * np.stack([np.cos(phi), np.sin(phi)])


def with_eccentricity(
    faults: NDArray[np.float64], vector: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a copy of fault vectors with another eccentricity, limited to 1, ``(m, 8)``.

    Parameters
    ----------
    faults
        The fault vectors, ``(m, 8)``.
    vector
        New ``zeta cos(phi)`` and ``zeta sin(phi)`` for each fault vector, ``(2, m)``.
    """
    x, y = vector
    result = faults.copy()
    result[:, ECCENTRICITY] = np.minimum(np.hypot(x, y), 1.0)
    result[:, ECCENTRICITY_PHASE] = (np.arctan2(y, x) / np.pi + 1.0) / 2.0
    return result


def degrade(plant: PlantConstants, faults: ArrayLike) -> PlantConstants:
    """Return plant constants with faults applied. A healthy vector changes nothing.

    Parameters
    ----------
    plant
        Constants of the healthy plant.
    faults
        One fault vector, ``(8,)``, or several, ``(n, 8)``. With several, the changed constants have
        shape ``(n,)``.

    Raises
    ------
    ValueError
        If a value is outside the range of a fault vector.

    Notes
    -----
    Equation M9; section 6.1 of the thesis.
    """
    k = fault_vector(faults)
    physical = np.moveaxis(_BASES + _SLOPES * k, -1, 0)
    friction, backlash, turns_a, turns_b, turns_c, zeta, _, gain = physical
    return PlantConstants(
        plant.control._replace(G_prop=plant.control.G_prop * gain),
        plant.motor._replace(
            N_a=plant.motor.N_a * turns_a,
            N_b=plant.motor.N_b * turns_b,
            N_c=plant.motor.N_c * turns_c,
            zeta=plant.motor.zeta + zeta,
            # The sum leaves phi exact for the healthy direction.
            phi=plant.motor.phi + eccentricity_angle(k[..., ECCENTRICITY_PHASE]),
        ),
        plant.mechanics._replace(
            f_s=plant.mechanics.f_s * friction,
            f_d=plant.mechanics.f_d * friction,
            half_backlash=plant.mechanics.half_backlash * backlash,
        ),
    )


def random_faults(rng: "np.random.Generator") -> NDArray[np.float64]:
    """Return a random multiple fault from the distribution of the thesis, ``(8,)`` (section 7.2).

    Most components are small, the phase is uniform, and the gain is near its healthy value.
    """
    r = rng.random(N_FAULTS)
    k = r**7
    k[ECCENTRICITY_PHASE] = r[ECCENTRICITY_PHASE]
    k[GAIN] = ((2.0 * r[GAIN] - 1.0) ** 7 + 1.0) / 2.0
    return np.minimum(k, HIGHEST)


def estimation_error(estimate: ArrayLike, truth: ArrayLike) -> float:
    """Return the error of an estimated fault vector in percent of the fault ranges.

    This form reproduces the printed errors of the thesis (equation M14): the phase is weighted with
    the estimated eccentricity. The phase difference is wrapped to half a turn.
    """
    k, k_true = np.asarray(estimate, dtype=float), np.asarray(truth, dtype=float)
    difference = k - k_true
    turn = difference[ECCENTRICITY_PHASE]
    difference[ECCENTRICITY_PHASE] = k[ECCENTRICITY] * (turn - np.round(turn))
    return float(100.0 * np.sqrt(np.sum(difference**2)))
