"""Figures of a calibration's healthy windows, by which later ones of the unit are judged (M47)."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, Final, Self

import numpy as np

from ema_core.telemetry import Telemetry
from ema_monitor.normal.features import FEATURES, TOLERANCE, Motion, Part, mean_of, parts_of
from ema_monitor.normal.normal import FEWEST_TESTS, Departure, HealthyTest, Normal

_Healthy = tuple[int, Part]

_LIKE: Final = 0.5
_SAME_LOAD: Final = 0.05
_BOTH_WAYS: Final = ("current_forward", "current_backward")


@dataclass(frozen=True)
class HealthyWindows:
    """When healthy windows began [ns], and their figures; each is a test of the unit's normal."""

    windows: tuple[_Healthy, ...] = ()

    @classmethod
    def of(cls, windows: Iterable[Telemetry]) -> Self:
        """Return the figures of windows; one without a stroke in each direction has none."""
        return cls(tuple((one.stamp_ns, part) for one in windows for part in figures_of(one)))

    @property
    def loads(self) -> tuple[float, float]:
        """The least and largest load, from their mean [A]; 0 where there is no window."""
        loads = [_load(part.features) for _, part in self.windows] or [0.0]
        mean = sum(loads) / len(loads)
        return min(loads) - mean, max(loads) - mean

    def departure(self, stamp_ns: int, parts: Sequence[Part]) -> Departure | None:
        """Return how unlikely a test is for the healthy unit, by its stretches.

        It is compared with healthy windows of its load, or the nearest one: with the means of as
        many in a row as it has stretches, so that like scatters are compared; of fewer, where there
        would not be ``FEWEST_TESTS`` means. None where it is unknown: there is no stretch, or fewer
        than half of the healthy windows have its motion, or than ``FEWEST_TESTS`` its load, too.
        """
        if not parts:
            return None
        motion, figures = mean_of(parts)
        alike = [one for one in self.windows if not one[1].motion.mismatch(motion, TOLERANCE)]
        if len(alike) < max(FEWEST_TESTS, _LIKE * len(self.windows)):
            return None
        running = max(abs(mean_of([part for _, part in alike])[1][name]) for name in _BOTH_WAYS)
        loads = _by_load(alike, _SAME_LOAD * running)
        far = [min(abs(_load(part.features) - _load(figures)) for _, part in one) for one in loads]
        alike = loads[int(np.argmin(far))]
        if len(alike) < FEWEST_TESTS:
            return None
        size = min(len(parts), len(alike) // FEWEST_TESTS)
        rows = [alike[at : at + size] for at in range(0, len(alike) - size + 1, size)]
        tests = [HealthyTest(row[0][0], mean_of([one for _, one in row])[1]) for row in rows]
        found = Normal(tests).departure(HealthyTest(stamp_ns, figures))
        return replace(found, at_known_load=len(loads) > 1 and min(far) <= _SAME_LOAD * running)

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values: names, and a row a window; a figure that it lacks is NaN."""
        rows = [
            [stamp, one.samples, *astuple(one.motion)]
            + [one.features.get(name, math.nan) for name in FEATURES]
            for stamp, one in self.windows
        ]
        return {"figures": list(FEATURES), "windows": rows}

    @classmethod
    def of_mapping(cls, content: dict[str, Any]) -> Self:
        """Return what ``as_mapping`` gives."""
        windows = []
        for number, row in enumerate(content["windows"]):
            samples, period, travel, speed, *values = map(float, row[1:])
            if not (0.0 < period < math.inf and 0.0 < travel * speed < math.inf):
                raise ValueError(f"normal: window {number} has no motion: make it anew")
            named = zip(content["figures"], values, strict=True)
            figures = {name: value for name, value in named if math.isfinite(value)}
            part = Part(Motion(period, travel, speed), figures, int(samples))
            windows.append((int(row[0]), part))
        return cls(tuple(windows))


def _by_load(windows: Sequence[_Healthy], gap: float) -> list[list[_Healthy]]:
    """Return windows in groups between which the load [A] has a gap, each in their order."""
    order = sorted(range(len(windows)), key=lambda at: _load(windows[at][1].features))
    sizes = np.diff([_load(windows[at][1].features) for at in order])
    groups = np.split(order, np.flatnonzero(sizes > gap) + 1)
    return [[windows[at] for at in sorted(group)] for group in groups]


def _load(figures: Mapping[str, float]) -> float:
    """Return the current that does not follow the direction [A]."""
    forward, backward = (figures[name] for name in _BOTH_WAYS)
    return 0.5 * (forward - backward)


def figures_of(telemetry: Telemetry) -> list[Part]:
    """Return the figures of a window; none where it has no current, or no stroke each way."""
    try:
        return parts_of([telemetry])
    except ValueError:
        return []
