"""A claim of the thesis, and what claims are measured with."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema_core.telemetry import Telemetry
from ema_study.response_figures_of_merit import AMPLITUDE, deviations
from ema_study.responses import SEVERITIES, chirp_comparison, reference_response
from ema_study.sources import MODEL_LABELS

ALIKE_PERCENT: Final = 5.0
"""Signals that differ by less than this part of the amplitude count as not affected [%]."""

AGREEING_SHARE: Final = 0.25
AGREEING_POINTS: Final = 1.0
"""A figure is the claimed one within this share of it [-] or these points of percent [%]."""

NOMINAL_PERCENT: Final = 10.0
"""Currents that differ by less than this count as nominal [%]."""


class Claim(NamedTuple):
    """A claim: the figure it is about, what was claimed, what we find, and whether that agrees."""

    figure: str
    fault: str
    command: str
    claim: str
    ours: str
    agrees: bool


def over_degrees(fault: str, command: str, measure: Callable[[Telemetry], float]) -> list[float]:
    """Measure the responses to all degrees of a fault."""
    return [measure(reference_response(fault, i, command)) for i in range(len(SEVERITIES[fault]))]


def rises(values: Sequence[float]) -> bool:
    """Return whether each value is above the one before."""
    return all(low < high for low, high in pairwise(values))


def falls(values: Sequence[float]) -> bool:
    """Return whether each value is below the one before."""
    return all(high > low for high, low in pairwise(values))


def is_nominal(ratio: float) -> bool:
    """Return whether a ratio to the nominal value counts as nominal."""
    return 100.0 * abs(ratio - 1.0) < NOMINAL_PERCENT


def from_to(values: Sequence[float], unit: str) -> str:
    """Return the first and the last value in words."""
    first, last = values[0], values[-1]
    return f"from {first:.3g} to {last:.3g} {unit}"


def position_claim(fault: str, figure: str) -> Claim:
    """Return the claim that the position under the chirp is not affected by a fault."""
    effect = _position_effect(fault)
    return Claim(
        figure,
        fault,
        "chirp",
        "the user's position is not affected",
        f"the worst degree moves it by at most {effect:.2g} % of the amplitude",
        effect < ALIKE_PERCENT,
    )


def agrees_with(found: float, claimed: float) -> bool:
    """Return whether a percentage is the claimed one, within a quarter or one point."""
    return bool(abs(found - claimed) <= max(AGREEING_SHARE * claimed, AGREEING_POINTS))


def range_agrees(found: NDArray[np.float64], claimed: tuple[float, float]) -> bool:
    """Return whether percentages go from one end of a claimed range to the other."""
    lowest, highest = float(found.min()), float(found.max())
    return agrees_with(lowest, claimed[0]) and agrees_with(highest, claimed[1])


def monitor_claim(
    figure: str, fault: str, claim: str, holds: Callable[[NDArray[np.float64]], bool]
) -> Claim:
    """Return a claim of how closely the monitor follows the reference.

    Parameters
    ----------
    figure, fault, claim
        As of `Claim`.
    holds
        Whether it holds of the differences of the thesis's model in each 0.1 s [%].
    """
    comparison = chirp_comparison(fault)
    by_model = {
        model: deviations(comparison.reference, current)
        for model, current in comparison.monitor.items()
    }
    found = "; ".join(
        f"{', '.join(f'{value:.1f}' for value in row)} % ({MODEL_LABELS[model]})"
        for model, row in by_model.items()
    )
    ours = f"in each 0.1 s {found}"
    return Claim(figure, fault, "chirp", claim, ours, holds(by_model["thesis"]))


def follows_closely(found: NDArray[np.float64]) -> bool:
    """Return whether a monitor follows "very well": alike in each 0.1 s."""
    return bool(found.max() <= ALIKE_PERCENT)


def _position_effect(fault: str) -> float:
    """Return by how much the worst degree moves the position under the chirp [% of amplitude]."""
    first, last = (reference_response(fault, i, "chirp").position for i in (0, -1))
    return 100.0 * float(np.abs(last - first).max()) / AMPLITUDE
