# SPDX-License-Identifier: Apache-2.0
"""Detection of effort ripple along the position, from cogging or gears, on healthy records."""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from ema_core.arrays import Array
from ema_monitor.joint.heldout import IMPROVES, general_design, halves, held_out_error
from ema_monitor.joint.signals import Preparation, Signals, filter_sigma

_Prepared = tuple[Preparation, list[Signals]]

_MOST: Final = 2
_FIRST_STEP: Final = 0.125  # periods over the travel
_FEWEST_PERIODS: Final = 1.5
_SLOW: Final = 0.2
_PASSED: Final = 2.0
_BINS_A_PERIOD: Final = 6.0
_PADDING: Final = 8
_MOST_BINS: Final = 1 << 15
_TINY: Final = 1e-12


def with_ripples(
    preparation: Preparation, prepared: Callable[[Preparation], list[Signals]], *, is_linear: bool
) -> tuple[Preparation, list[Signals]]:
    """Return a preparation with the ripples that improve the prediction, and the prepared records.

    At most two ripples are added. The search for a ripple uses every other stroke of each record. A
    ripple is accepted if it reduces the prediction error on the remaining strokes by 5 % (geometric
    mean over the records).

    Parameters
    ----------
    preparation
        Preparation without ripple terms.
    prepared
        Function that applies a preparation to the healthy records.
    is_linear
        Whether the joint is linear, so that gravity does not depend on its position.
    """
    signals = prepared(preparation)
    error = held_out_error(signals, is_linear=is_linear)
    for _ in range(_MOST):
        wave_number = _strongest(signals, preparation, is_linear=is_linear)
        if wave_number is None:
            break

        def evaluate(wave: float, before: Preparation = preparation) -> tuple[float, _Prepared]:
            wider = before._replace(ripples=(*before.ripples, wave))
            rows = prepared(wider)
            return held_out_error(rows, is_linear=is_linear), (wider, rows)

        best = wave_number, *evaluate(wave_number)
        if not best[1] < IMPROVES * error:
            break
        step = _FIRST_STEP / max(float(np.ptp(record.position)) for record in signals)
        for size in (step, step / 4.0):
            near = [(wave, *evaluate(wave)) for wave in (best[0] - size, best[0] + size)]
            lowest = _lowest(near[0][:2], best[:2], near[1][:2])
            best = min([best, *near, (lowest, *evaluate(lowest))], key=lambda wave: wave[1])
        _, error, (preparation, signals) = best
    return preparation, signals


def _lowest(
    left: tuple[float, float], middle: tuple[float, float], right: tuple[float, float]
) -> float:
    """Return the wave number at the minimum of the parabola through (wave number, error) points.

    It is limited to the interval between the points. Without a minimum, it is the middle point.
    """
    size = middle[0] - left[0]
    bend = left[1] - 2.0 * middle[1] + right[1]
    offset = 0.5 * (left[1] - right[1]) / bend if bend > 0.0 else 0.0
    return middle[0] + size * max(-1.0, min(1.0, offset))


def _strongest(
    records: Sequence[Signals], preparation: Preparation, *, is_linear: bool
) -> float | None:
    """Return the wave number of the strongest ripple in the residuals [1/rad].

    The search excludes ripples that the filter suppresses even in slow strokes. The result is None
    if no ripple explains enough of the residuals.
    """
    sigma_s = filter_sigma(preparation.cutoff_hz)
    parts = [_Half(halves(record)[0], sigma_s, is_linear=is_linear) for record in records]
    parts = [half for half in parts if half.travel > 0.0]
    if not parts:
        return None
    travel = max(half.travel for half in parts)
    lowest = _FEWEST_PERIODS / float(np.median([half.travel for half in parts]))
    highest = _PASSED * preparation.cutoff_hz / (_SLOW * preparation.usual_speed)
    bins = 1 << math.ceil(math.log2(max(2.0, _BINS_A_PERIOD * highest * travel)))
    bins = min(bins, _MOST_BINS)
    width = travel / (bins - 1)
    power = np.sum([half.spectrum(width, bins) for half in parts], axis=0)
    waves = np.arange(len(power)) / (width * _PADDING * bins)
    within = (waves >= lowest) & (waves <= highest)
    if not np.any(within):
        return None
    best = float(waves[np.argmax(np.where(within, power, -1.0))])
    explained = 0.0
    for reach, count in ((1.0, 8), (0.125, 4)):
        near = best + reach / travel * np.arange(-count, count + 1) / count
        shares = [float(np.mean([half.explained(wave) for half in parts])) for wave in near]
        best, explained = float(near[np.argmax(shares)]), max(shares)
    return best if explained > 1.0 - IMPROVES**2 and best >= lowest else None


class _Half:
    """Every other stroke of a record, and the residuals of the model without a further ripple.

    Parameters
    ----------
    signals
        Rows of the strokes.
    sigma_s
        Standard deviation of the filter [s].
    is_linear
        Whether the joint is linear, so that gravity does not depend on its position.
    """

    def __init__(self, signals: Signals, sigma_s: float, *, is_linear: bool) -> None:
        self.travel = float(np.ptp(signals.position)) if len(signals) else 0.0
        self._position, self._blur = signals.position, sigma_s * np.abs(signals.speed)
        if not self.travel > 0.0:
            return
        basis, sizes, _ = np.linalg.svd(
            general_design(signals, is_linear=is_linear), full_matrices=False
        )
        self._basis = basis[:, sizes > _TINY * sizes[0]]
        self._residuals = signals.effort - self._basis @ (self._basis.T @ signals.effort)
        self._power = float(self._residuals @ self._residuals) + _TINY

    def spectrum(self, width: float, bins: int) -> Array:
        """Return the power spectrum of the residuals over the position.

        The residuals are summed in ``bins`` bins of ``width`` [rad]. The first bin begins at the
        lowest position, because the zero of the position may differ between records.
        """
        place = np.rint((self._position - self._position.min()) / width).astype(np.intp)
        sums = np.bincount(place, self._residuals, bins)
        power: Array = np.abs(np.fft.rfft(sums, _PADDING * bins)) ** 2
        return power / (len(place) * self._power)

    def explained(self, wave_number: float) -> float:
        """Return the share of the residual power that a filtered ripple explains [-].

        The filter is approximated by its gain at the speed of each row, because applying the exact
        filter for every trial wave number would be too slow.
        """
        phase = 2.0 * math.pi * wave_number * self._position
        passed = np.exp(-0.5 * (2.0 * math.pi * wave_number * self._blur) ** 2)
        waves = np.column_stack([passed * np.sin(phase), passed * np.cos(phase)])
        waves -= self._basis @ (self._basis.T @ waves)
        moments = waves.T @ self._residuals
        matrix = waves.T @ waves + _TINY * np.eye(2)
        return float(moments @ np.linalg.solve(matrix, moments)) / self._power
