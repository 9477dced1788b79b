"""Result of comparing a record with the baseline of its unit, as typed values."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Final, NamedTuple, Self


class Judgement(StrEnum):
    """What a record says about one quantity."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"
    NOT_JUDGED = "not judged"


JUDGEMENTS: Final = (Judgement.UNCHANGED, Judgement.CHANGED, Judgement.NOT_JUDGED)
"""Judgements, in the order of their numbers in ``ema_interfaces/msg/QuantityChange``."""


class Quantity(NamedTuple):
    """A physical quantity of a joint.

    Attributes
    ----------
    label
        Name in words.
    reference
        What a relative change is a share of.
    """

    label: str
    reference: str = "healthy"


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
"""The quantities of a comparison, by name, in the order in which they are shown."""

FAULTS_OF_RECORDS: Final[Mapping[str, str]] = {FRICTION: "friction", PLAY: "backlash"}
"""Fault of each quantity that is one; a record of an unknown drive shows no other faults."""


@dataclass(frozen=True)
class QuantityChange:
    """Change of one quantity of a joint.

    Attributes
    ----------
    name
        Name in ``QUANTITIES``.
    judgement
        Whether it has changed.
    change
        Test over healthy, less 1 [-]; of a quantity that is not relative, test less healthy, in
        ``unit``. NaN where it is not judged.
    low, high
        90 % interval of ``change``.
    smallest_change
        Smallest change that would be detected with a probability of 90 %, as ``change``.
    unit
        Unit of the figures above: "-" for a relative change.
    reason
        Why the quantity is not judged; empty where it is.
    rivals
        Names of quantities that explain the record as well as this one.
    """

    name: str
    judgement: Judgement
    change: float = math.nan
    low: float = math.nan
    high: float = math.nan
    smallest_change: float = math.nan
    unit: str = "-"
    reason: str = ""
    rivals: tuple[str, ...] = ()

    @property
    def is_judged(self) -> bool:
        """Whether the record says anything about the quantity."""
        return self.judgement is not Judgement.NOT_JUDGED

    @property
    def is_estimated(self) -> bool:
        """Whether the change is a figure of this quantity, judged or not, and not of a rival."""
        return math.isfinite(self.change) and (self.is_judged or not self.rivals)


@dataclass(frozen=True)
class FigureChange:
    """A figure of the record that needs no model and differs from the healthy records.

    Attributes
    ----------
    name
        Name in ``ema_monitor.joint.figures.FIGURES``.
    ratio
        Test over healthy [-].
    probability
        Probability that a healthy record differs as much in this figure.
    """

    name: str
    ratio: float
    probability: float


@dataclass(frozen=True)
class Improvement:
    """Further healthy records that would lower the smallest detectable change of a quantity.

    Attributes
    ----------
    name
        Name in ``QUANTITIES``.
    days
        Number of further days with healthy records; 0 for records of a day that has some.
    records
        Number of further healthy records in all.
    present_change, smallest_change
        Smallest detectable change on a day without healthy records, now and with these records, in
        the unit of ``QuantityChange``.
    """

    name: str
    days: int
    records: int
    present_change: float
    smallest_change: float


@dataclass(frozen=True)
class Comparison:
    """Comparison of one record with the healthy records of its unit.

    Attributes
    ----------
    quantities
        One entry for each of ``QUANTITIES``, in their order.
    figures
        Model-free figures that differ significantly, the most significant first.
    probability
        Probability that a healthy record differs as much as this one; NaN where nothing is judged.
    states
        Probabilities of the states that the owner has labelled, the largest first.
    improvements
        Healthy records that would lower the smallest detectable changes, the most useful first.
    """

    quantities: tuple[QuantityChange, ...]
    figures: tuple[FigureChange, ...] = ()
    probability: float = math.nan
    states: Mapping[str, float] | None = None
    improvements: tuple[Improvement, ...] = ()

    def __getitem__(self, name: str) -> QuantityChange:
        """Return the change of a quantity."""
        return next(quantity for quantity in self.quantities if quantity.name == name)

    @property
    def changed(self) -> tuple[QuantityChange, ...]:
        """The quantities that have changed."""
        return tuple(
            quantity for quantity in self.quantities if quantity.judgement is Judgement.CHANGED
        )

    @property
    def judged(self) -> tuple[QuantityChange, ...]:
        """The quantities about which the record says something."""
        return tuple(quantity for quantity in self.quantities if quantity.is_judged)

    @property
    def doubtful(self) -> tuple[QuantityChange, ...]:
        """The quantities that differ beyond usual variation, but not for certain."""
        return tuple(
            quantity
            for quantity in self.quantities
            if quantity.is_estimated and not quantity.is_judged
        )

    @property
    def has_departed(self) -> bool:
        """Whether anything differs significantly from the healthy records."""
        return bool(self.changed or self.figures)

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values for JSON, NaN included."""
        content = asdict(self)
        for quantity in content["quantities"]:
            quantity["judgement"], quantity["rivals"] = (
                str(quantity["judgement"]),
                list(quantity["rivals"]),
            )
        return content | {
            "quantities": list(content["quantities"]),
            "figures": list(content["figures"]),
            "improvements": list(content["improvements"]),
        }

    @classmethod
    def of_mapping(cls, content: Mapping[str, Any]) -> Self:
        """Return the comparison of ``as_mapping``, or read from JSON with None for NaN.

        Raises
        ------
        KeyError, TypeError, ValueError
            When the mapping is no comparison.
        """

        def number(value: Any) -> float:
            return math.nan if value is None else float(value)

        quantities = tuple(
            QuantityChange(
                str(quantity["name"]),
                Judgement(quantity["judgement"]),
                number(quantity["change"]),
                number(quantity["low"]),
                number(quantity["high"]),
                number(quantity["smallest_change"]),
                str(quantity["unit"]),
                str(quantity["reason"]),
                tuple(map(str, quantity["rivals"])),
            )
            for quantity in content["quantities"]
        )
        figures = tuple(
            FigureChange(
                str(figure["name"]), number(figure["ratio"]), number(figure["probability"])
            )
            for figure in content["figures"]
        )
        states = content["states"]
        if states is not None:
            states = {str(name): float(share) for name, share in states.items()}
        improvements = tuple(
            Improvement(
                str(improvement["name"]),
                int(improvement["days"]),
                int(improvement["records"]),
                number(improvement["present_change"]),
                number(improvement["smallest_change"]),
            )
            for improvement in content["improvements"]
        )
        return cls(quantities, figures, number(content["probability"]), states, improvements)


def not_judged(reason: str) -> Comparison:
    """Return the comparison of a record from which no quantity can be judged."""
    return Comparison(
        tuple(QuantityChange(name, Judgement.NOT_JUDGED, reason=reason) for name in QUANTITIES)
    )
