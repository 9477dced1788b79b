# SPDX-License-Identifier: Apache-2.0
"""Result of the comparison of a record with the baseline of its unit."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from typing import Any, Final, Self

from ema_monitor.quantities import QUANTITIES
from ema_monitor.reason_texts import joined
from ema_monitor.reasons import Reason


class Judgement(StrEnum):
    """Result of comparing one quantity of a record with its healthy value."""

    CHANGED = "changed"
    UNCHANGED = "unchanged"
    NOT_JUDGED = "not judged"


JUDGEMENTS: Final = (Judgement.UNCHANGED, Judgement.CHANGED, Judgement.NOT_JUDGED)
"""Judgements, in the order of their numbers in ``ema_interfaces/msg/QuantityChange``."""


@dataclass(frozen=True)
class QuantityChange:
    """Change of one quantity of a joint."""

    name: str
    """Name in ``QUANTITIES``."""
    judgement: Judgement
    """Whether the quantity has changed."""
    change: float = math.nan
    """Ratio of measured to healthy value, minus 1 [-]; for an absolute change, measured minus
    healthy value, in ``unit``. NaN if there is no estimate; ``is_estimated`` excludes estimates
    that may belong to a rival."""
    low: float = math.nan
    """Lower end of the 90 % interval of ``change``."""
    high: float = math.nan
    """Upper end of the 90 % interval of ``change``."""
    smallest_change: float = math.nan
    """Smallest change that is detected with a probability of 90 %, in the unit of ``change``."""
    unit: str = "-"
    """Unit of ``change``, ``low``, ``high`` and ``smallest_change``: "-" for a relative change."""
    reasons: tuple[Reason, ...] = ()
    """Why the quantity is not judged; empty if it is judged."""
    rivals: tuple[str, ...] = ()
    """Names of quantities that explain the record equally well."""

    @property
    def reason(self) -> str:
        """Why the quantity is not judged, as a sentence; empty if it is judged."""
        return joined(self.reasons)

    @property
    def is_judged(self) -> bool:
        """Whether the quantity is judged as changed or unchanged."""
        return self.judgement is not Judgement.NOT_JUDGED

    @property
    def is_estimated(self) -> bool:
        """Whether ``change`` is an estimate of this quantity and not of a rival."""
        return math.isfinite(self.change) and (self.is_judged or not self.rivals)

    def as_mapping(self) -> dict[str, Any]:
        """Return the change and its ``reason`` as plain values."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return values | {
            "judgement": str(self.judgement),
            "reason": self.reason,
            "reasons": [reason.as_record() for reason in self.reasons],
            "rivals": list(self.rivals),
        }


@dataclass(frozen=True)
class FigureChange:
    """A model-free figure of a record that differs from the healthy records."""

    name: str
    """Name in ``ema_monitor.joint.figures.FIGURES``."""
    ratio: float
    """Ratio of the tested to the healthy value [-]."""
    probability: float
    """Probability that the figure differs at least as much in a healthy record."""


@dataclass(frozen=True)
class Improvement:
    """Healthy records that would lower the smallest detectable change of a quantity."""

    name: str
    """Name in ``QUANTITIES``."""
    days: int
    """Number of additional days with healthy records; 0 adds records to an existing day."""
    records: int
    """Number of additional healthy records."""
    present_change: float
    """Smallest change that is currently detectable on a day without healthy records, in the unit of
    the quantity."""
    smallest_change: float
    """Smallest detectable change with the additional healthy records."""


@dataclass(frozen=True)
class Comparison:
    """Comparison of one record with the healthy records of its unit."""

    quantities: tuple[QuantityChange, ...]
    """One entry per quantity, in the order of ``QUANTITIES``."""
    figures: tuple[FigureChange, ...] = ()
    """Model-free figures that differ significantly, the most significant first."""
    probability: float = math.nan
    """Probability that a healthy record differs at least as much; NaN if nothing is judged."""
    states: Mapping[str, float] | None = None
    """Probabilities of the healthy and labelled states and of ``NONE_OF_THESE``, the largest first;
    None if no states are compared."""
    improvements: tuple[Improvement, ...] = ()
    """Healthy records that would lower the smallest detectable changes, the most useful first."""

    def __getitem__(self, name: str) -> QuantityChange:
        """Return the change of the quantity ``name``, a name in ``QUANTITIES``."""
        return next(quantity for quantity in self.quantities if quantity.name == name)

    @property
    def changed(self) -> tuple[QuantityChange, ...]:
        """The quantities that have changed."""
        return tuple(
            quantity for quantity in self.quantities if quantity.judgement is Judgement.CHANGED
        )

    @property
    def judged(self) -> tuple[QuantityChange, ...]:
        """The quantities with a definite judgement: changed or unchanged."""
        return tuple(quantity for quantity in self.quantities if quantity.is_judged)

    @property
    def doubtful(self) -> tuple[QuantityChange, ...]:
        """The quantities that may have changed: their change is estimated, but not judged."""
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
        """Return the comparison as plain values for JSON; NaN is not replaced."""
        content = asdict(self)
        return content | {
            "quantities": [quantity.as_mapping() for quantity in self.quantities],
            "figures": list(content["figures"]),
            "improvements": list(content["improvements"]),
        }

    @classmethod
    def of_mapping(cls, content: Mapping[str, Any]) -> Self:
        """Return a comparison from the output of ``as_mapping``; None is read as NaN.

        Raises
        ------
        KeyError, TypeError, ValueError
            If a field is missing or has the wrong type.
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
                tuple(map(Reason.of_record, quantity["reasons"])),
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


def not_judged(*reasons: Reason) -> Comparison:
    """Return a comparison in which no quantity is judged."""
    return Comparison(
        tuple(QuantityChange(name, Judgement.NOT_JUDGED, reasons=reasons) for name in QUANTITIES)
    )
