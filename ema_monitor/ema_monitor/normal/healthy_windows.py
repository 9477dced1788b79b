"""Figures of a calibration's healthy windows, by which later ones of the unit are judged (M47)."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass
from typing import Any, Final, Self

from ema_core.telemetry import Telemetry
from ema_monitor.normal.features import FEATURES, TOLERANCE, Motion, Part, mean_of, parts_of
from ema_monitor.normal.normal import FEWEST_TESTS, Departure, HealthyTest, Normal

_LIKE: Final = 0.5


@dataclass(frozen=True)
class HealthyWindows:
    """When healthy windows began [ns], and their figures; each is a test of the unit's normal."""

    windows: tuple[tuple[int, Part], ...] = ()

    @classmethod
    def of(cls, windows: Iterable[Telemetry]) -> Self:
        """Return the figures of windows; one without a stroke in each direction has none."""
        return cls(tuple((one.stamp_ns, part) for one in windows for part in figures_of(one)))

    def departure(self, stamp_ns: int, parts: Sequence[Part]) -> Departure | None:
        """Return how unlikely a test is for the healthy unit, by its stretches.

        It is compared with the means of as many healthy windows in a row as it has stretches, so
        that like scatters are compared; of fewer, where there would not be ``FEWEST_TESTS`` means.
        None where it is unknown: there is no stretch, or fewer than half of the healthy windows, or
        fewer than ``FEWEST_TESTS``, have its motion.
        """
        if not parts:
            return None
        motion, figures = mean_of(parts)
        alike = [one for one in self.windows if not one[1].motion.mismatch(motion, TOLERANCE)]
        if len(alike) < max(FEWEST_TESTS, _LIKE * len(self.windows)):
            return None
        size = min(len(parts), len(alike) // FEWEST_TESTS)
        rows = [alike[at : at + size] for at in range(0, len(alike) - size + 1, size)]
        tests = [HealthyTest(row[0][0], mean_of([one for _, one in row])[1]) for row in rows]
        return Normal(tests).departure(HealthyTest(stamp_ns, figures))

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


def figures_of(telemetry: Telemetry) -> list[Part]:
    """Return the figures of a window; none where it has no current, or no stroke each way."""
    try:
        return parts_of([telemetry])
    except ValueError:
        return []
