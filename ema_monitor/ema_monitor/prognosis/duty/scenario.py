# SPDX-License-Identifier: Apache-2.0
"""Scenarios: future duties specified by a planner, their validation, and the resulting growth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ema_core.faults import Damage
from ema_core.quantity import Checked, is_finite_number, quantity, text
from ema_core.wording import unknown_name
from ema_core.yaml_file import load_yaml
from ema_monitor.prognosis.duty.course import DutyCourse, FutureDuty
from ema_monitor.prognosis.duty.damage import MEASURE

MOST_SCENARIOS: Final = 20
"""Largest number of scenarios in a request."""

_LONGEST_NAME: Final = 64
_MOST_CLASSES: Final = 50
_TOLERANCE: Final = 1e-3


@dataclass(frozen=True)
class Scenario(Checked):
    """A future duty; omitted values are as in the unit's past.

    Raises
    ------
    ValueError
        If a value is impossible; the message names its key, the value and the expected values.
    """

    name: str = text("", "name of the scenario in the result")
    duty: float = quantity(
        1.0, "-", 1e-3, 1e3, "factor of growth in addition to the effect of other values"
    )
    travel_per_hour: float = quantity(
        0.0, "rad/h", 0.0, 1e7, "travel of the user shaft per service hour; 0: as in the past"
    )
    loads: Mapping[float, float] = field(default_factory=dict)
    """Share of the travel by load, the ratio of the current magnitude to its limit; empty: as in
    the past."""
    winding: Mapping[float, float] = field(default_factory=dict)
    """Share of the service hours by winding temperature [degC]; empty: as in the past."""
    hours_per_cycle: float = quantity(
        0.0, "h", 0.0, 1e6, "service hours per test cycle; 0: as in the past"
    )
    hours_per_day: float = quantity(
        0.0, "h/d", 0.0, 24.0, "service hours per calendar day; 0: as in the past"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < len(self.name) <= _LONGEST_NAME or not self.name.isprintable():
            raise ValueError(
                f"name = {self.name[:80]!r}: expected 1 to {_LONGEST_NAME} printable characters"
            )
        _check_shares("loads", self.loads, 0.0, 10.0, "-")
        _check_shares("winding", self.winding, -60.0, 300.0, "degC")

    def future(self, course: DutyCourse | None, factor: float) -> FutureDuty:
        """Return the future duty of a unit under the scenario.

        Parameters
        ----------
        course
            Duty of the unit so far; None if unknown.
        factor
            Factor of growth in addition to the scenario's factor [-].

        Raises
        ------
        NotComparableError
            If the scenario has values for which the unit has no data.
        """
        factor = factor * self.duty
        names = ("travel_per_hour", "loads", "winding")
        planned = {name: getattr(self, name) for name in names if getattr(self, name)}
        past = FutureDuty(factor) if course is None else course.as_flown(factor)
        if not planned:
            return past
        if course is None:
            raise NotComparableError("its duty so far")
        wear, _, travel = course.lately(course.hourly)
        rates: dict[int, float] = {}
        if self.travel_per_hour or self.loads:
            by_load = wear / (travel or np.nan)
            if self.loads:
                by_load = course.settings.wear(list(self.loads.values()), list(self.loads))
            rates[Damage.WEAR] = (self.travel_per_hour or travel) * by_load
        if self.winding:
            rates[Damage.AGEING] = course.settings.ageing(
                list(self.winding.values()), list(self.winding)
            )
        present, later = past.present.copy(), past.later.copy()
        for measure, hourly in rates.items():
            rate = hourly / course.reference[measure]
            if not np.isfinite(rate):
                names = ("its travel and load so far", "the temperature of its winding so far")
                raise NotComparableError(names[measure])
            present[measure == MEASURE] = later[measure == MEASURE] = rate
        return replace(past, present=present, later=later, planned=planned)


class NotComparableError(ValueError):
    """The unit has no data to which a value of a scenario could be compared."""

    def __init__(self, figure: str) -> None:
        super().__init__(
            f"{figure} is unknown, but the scenario is relative to it: growth is counted in "
            "service hours"
        )


def _check_shares(name: str, shares: Any, lowest: float, highest: float, unit: str) -> None:
    if not isinstance(shares, Mapping) or len(shares) > _MOST_CLASSES:
        raise ValueError(
            f"{name} = {str(shares)[:80]}: expected values with shares, {_MOST_CLASSES} at most"
        )
    for value, share in shares.items():
        if not is_finite_number(value) or not lowest <= value <= highest:
            raise ValueError(
                f"{name}: {value!r}: expected a number in [{lowest:g}, {highest:g}] {unit}"
            )
        if not is_finite_number(share) or not 0.0 <= share <= 1.0:
            raise ValueError(f"{name}: share {share!r} at {value:g}: expected a number in [0, 1]")
    if shares and not abs(sum(shares.values()) - 1.0) <= _TOLERANCE:
        raise ValueError(f"{name}: the shares sum to {sum(shares.values()):g}: expected 1")


AS_FLOWN: Final = Scenario("as flown")
"""Future duty as in the past."""


def scenarios_of(rows: Sequence[Any]) -> tuple[Scenario, ...]:
    """Return the scenarios defined by mappings of keys to values, as read from a file.

    Raises
    ------
    ValueError
        If there are too many scenarios, a name is repeated, or a scenario is impossible; the
        message names it.
    """
    if len(rows) > MOST_SCENARIOS:
        raise ValueError(f"{len(rows)} scenarios: expected at most {MOST_SCENARIOS}")
    scenarios: dict[str, Scenario] = {}
    keys = [item.name for item in fields(Scenario)]
    for number, row in enumerate(rows, 1):
        try:
            if not isinstance(row, dict):
                raise ValueError(f"{str(row)[:80]}: expected a mapping of keys to values")
            for key in row:
                if key not in keys:
                    raise ValueError(unknown_name("key", key, keys))
            scenario = Scenario(**row)
            if scenario.name in scenarios:
                raise ValueError(f"name = {scenario.name!r} is repeated")
            scenarios[scenario.name] = scenario
        except ValueError as error:
            raise ValueError(f"scenario {number}: {error}") from error
    return tuple(scenarios.values())


def read_scenarios(path: Path) -> tuple[Scenario, ...]:
    """Return the scenarios in a YAML file.

    Raises
    ------
    ValueError
        If the file is not a scenario file; the message names file, scenario, key and value.
    OSError
        If the file cannot be read.
    """
    content = load_yaml(path)
    try:
        rows = content.get("scenarios") if isinstance(content, dict) and len(content) == 1 else None
        if not isinstance(rows, list) or not rows:
            raise ValueError(f"{str(content)[:80]}: expected one key, scenarios, with a list")
        return scenarios_of(rows)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
