"""How the other units of a model grew, as a tracker uses it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class FleetPrior:
    """The distribution of curves and rates over the units of a fleet.

    Attributes
    ----------
    digest
        Of all that the units said.
    units
        Number of units that any of the faults of which was seen to grow.
    names
        The fleet in words; empty when it has no name.
    shares
        Probability of each curve and rate of faults that grow, by kind of the fault,
        ``(curves, rates)``; sums to 1. Kinds that no unit was seen to have are missing.
    counts
        Number of faults that it rests on, by kind.
    """

    digest: str
    units: int
    names: str = ""
    counts: Mapping[str, int] = field(default_factory=dict, compare=False, repr=False)
    shares: Mapping[str, NDArray[np.float64]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def in_words(self) -> str:
        """Return whose growth is assumed."""
        others = f"{self.units} other{'' if self.units == 1 else 's'}"
        return f"growth is likely as of {others}" + (f" ({self.names})" if self.names else "")
