"""Which formula the thesis's printed errors follow: candidates, and how many each reproduces."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ema_core.faults import ECCENTRICITY, ECCENTRICITY_PHASE
from ema_study.printed_runs import printed_runs
from ema_study.record import K

HIGH_BACKLASHES: Final = {"0.747": 0.747, "74/99": 74 / 99, "0.7474": 0.7474}
"""The true high backlash as the thesis prints it, as its play of 75 times the nominal one gives it,
and that in four decimals as the other figures have them."""

_THREE_DECIMALS = (9, 10, 56, 57)
_HALF_DIGIT_OF_ESTIMATE = 0.5e-4


@dataclass(frozen=True)
class ErrorForm:
    """A formula of the error of an estimate: how much the difference of the phase counts.

    The error is 100 times the root of the sum of squared differences in percent, that of the
    phase times a weight.

    Attributes
    ----------
    name
        What it is.
    weight_text
        The weight, k the estimate, k_true the truth.
    weight
        The weight as a function of the eccentricities of estimates and truths, ``(n,)`` each.
    """

    name: str
    weight_text: str
    weight: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

    def errors(
        self, estimates: NDArray[np.float64], truths: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the errors of estimates, ``(n, 8)``, ``(n,)`` [%]."""
        squares = self._weighted_squares(estimates, truths)
        return 100.0 * np.sqrt(np.sum(squares, axis=1))

    def _weighted_squares(
        self, estimates: NDArray[np.float64], truths: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        squares = (estimates - truths) ** 2
        squares[:, ECCENTRICITY_PHASE] *= self.weight(
            estimates[:, ECCENTRICITY], truths[:, ECCENTRICITY]
        )
        return squares


FORMS: Final = (
    ErrorForm("spread by the estimated eccentricity", "k6^2", lambda k, true: k**2),
    ErrorForm("eq. 7.1 as printed", "k_true6", lambda k, true: true),
    ErrorForm("eq. 7.1 with the estimate under the hat", "k6", lambda k, true: k),
    ErrorForm("spread by the true eccentricity", "k_true6^2", lambda k, true: true**2),
    ErrorForm("spread by both eccentricities", "k6 k_true6", lambda k, true: k * true),
    ErrorForm("no phase", "0", lambda k, true: np.zeros_like(k)),
    ErrorForm("phase as any other component", "1", lambda k, true: np.ones_like(k)),
)
"""The candidates; the first one is what the printed errors follow (M14), but for its wrap."""


def rounding(
    form: ErrorForm,
    estimates: NDArray[np.float64],
    truths: NDArray[np.float64],
    tables: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Return how far a printed error may be from the formula by rounding alone, ``(n,)`` [%].

    Half a digit of the error, printed with two decimals, or three in tables 9, 10, 56 and 57; and
    what half a digit of the four decimals of each component of the estimate does to the formula,
    all of them at their worst.
    """
    half_digit = np.where(np.isin(tables, _THREE_DECIMALS), 0.5e-3, 0.5e-2)
    nearby = np.zeros(len(estimates))
    here = form.errors(estimates, truths)
    for component in range(estimates.shape[1]):
        changes = []
        for sign in (-1.0, 1.0):
            moved = estimates.copy()
            moved[:, component] += sign * _HALF_DIGIT_OF_ESTIMATE
            moved = np.maximum(moved, 0.0)  # no estimate is negative
            changes.append(np.abs(form.errors(moved, truths) - here))
        nearby += np.max(changes, axis=0)
    return half_digit + nearby


def reproduction(frame: pd.DataFrame | None = None) -> pd.DataFrame:
    """Return how many printed errors each candidate reproduces.

    Parameters
    ----------
    frame
        Printed runs; all 500 by default.

    Returns
    -------
    pandas.DataFrame
        Index the form's name; columns "weight of the phase", "runs", then for each of
        ``HIGH_BACKLASHES``: how many errors are reproduced within rounding, e.g. "reproduced with
        74/99", and "largest deviation with 74/99 [%]".
    """
    runs = printed_runs() if frame is None else frame
    estimates = runs[K].to_numpy(dtype=float)
    printed_truths = runs[[f"true_{k}" for k in K]].to_numpy(dtype=float)
    is_high_backlash = printed_truths == HIGH_BACKLASHES["0.747"]
    errors = runs["error_percent"].to_numpy(dtype=float)
    tables = runs["table"].to_numpy()
    rows = {}
    for form in FORMS:
        row: dict[str, object] = {"weight of the phase": form.weight_text, "runs": len(runs)}
        for name, high_backlash in HIGH_BACKLASHES.items():
            truths = np.where(is_high_backlash, high_backlash, printed_truths)
            deviations = np.abs(form.errors(estimates, truths) - errors)
            within = deviations <= rounding(form, estimates, truths, tables)
            row[f"reproduced with {name}"] = int(np.sum(within))
            row[f"largest deviation with {name} [%]"] = float(np.max(deviations, initial=0.0))
        rows[form.name] = row
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("form")
