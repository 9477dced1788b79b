"""Scenarios: duties to come as a planner gives them, checked, and the growth that they lead to."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from ema_core.quantity import check_quantities, is_finite_number, quantity, text
from ema_core.wording import unknown_name
from ema_core.yaml_file import load_yaml
from ema_monitor.prognosis.duty.course import DutyCourse
from ema_monitor.prognosis.duty.damage import MEASURE
from ema_monitor.prognosis.duty.future import FutureDuty

MOST_SCENARIOS: Final = 20
"""Scenarios that are answered at once."""

_LONGEST_NAME: Final = 64
_MOST_CLASSES: Final = 50
_TOLERANCE: Final = 1e-3


@dataclass(frozen=True)
class Scenario:
    """A future duty; what is not given is as in the unit's past.

    Attributes
    ----------
    loads
        Share of the travel by load, the magnitude of the current over its limit; empty: as in the
        past.
    winding
        Share of the flight hours by temperature of the winding [degC]; empty: as in the past.

    Raises
    ------
    ValueError
        When a value is impossible; the message names its key, the value and what is expected.
    """

    name: str = text("", "how the answer names it")
    duty: float = quantity(1.0, "-", 1e-3, 1e3, "growth beside what the other figures say of it")
    travel_per_hour: float = quantity(
        0.0, "rad/h", 0.0, 1e7, "travel of the user shaft in a flight hour; 0: as in the past"
    )
    loads: Mapping[float, float] = field(default_factory=dict)
    winding: Mapping[float, float] = field(default_factory=dict)
    hours_per_cycle: float = quantity(
        0.0, "h", 0.0, 1e6, "flight hours of a test cycle; 0: as in the past"
    )
    hours_per_day: float = quantity(
        0.0, "h/d", 0.0, 24.0, "flight hours in a day of the calendar; 0: as in the past"
    )

    def __post_init__(self) -> None:
        check_quantities(self)
        if not 0 < len(self.name) <= _LONGEST_NAME or not self.name.isprintable():
            raise ValueError(
                f"name = {self.name[:80]!r}: expected 1 to {_LONGEST_NAME} printable characters"
            )
        _check_shares("loads", self.loads, 0.0, 10.0, "-")
        _check_shares("winding", self.winding, -60.0, 300.0, "degC")

    def future(self, course: DutyCourse | None, factor: float) -> FutureDuty:
        """Return the duty to come.

        Parameters
        ----------
        course
            Duty of the unit so far; None when it is not known.
        factor
            Growth beside that of the scenario [-].

        Raises
        ------
        NotComparableError
            When the scenario has figures that nothing of the unit can be compared with.
        """
        factor = factor * self.duty
        if course is None:
            if self.travel_per_hour or self.loads or self.winding:
                raise NotComparableError("its duty so far")
            return FutureDuty.steady(factor)
        past, settings = course.as_flown(factor), course.settings
        rates: dict[int, float] = {}
        words = []
        if self.travel_per_hour or self.loads:
            known = course.lately(course.travel)
            travel = self.travel_per_hour or known
            if self.loads:
                shares = np.array(list(self.loads.values()))
                wear = settings.wear(shares / shares.sum(), list(self.loads))
            else:
                wear = course.lately(course.rate[0]) / (known or np.nan)
            rates[0] = travel * wear / course.reference[0]
            words.append(f"{travel:.4g} rad/h")
            words += [f"loads {_in_words(self.loads, '')}"] if self.loads else []
        if self.winding:
            shares = np.array(list(self.winding.values()))
            rates[1] = settings.ageing(shares / shares.sum(), list(self.winding))
            rates[1] /= course.reference[1]
            words.append(f"winding {_in_words(self.winding, ' degC')}")
        if not words:
            return past
        present, later = past.present.copy(), past.later.copy()
        for measure, rate in rates.items():
            if not np.isfinite(rate):
                names = ("its travel and load so far", "the temperature of its winding so far")
                raise NotComparableError(names[measure])
            present[measure == MEASURE] = later[measure == MEASURE] = rate
        rest = past.words.partition(" duty ")[2]
        given = f"future duty: {', '.join(words)}, the rest {rest}"
        return replace(past, present=present, later=later, words=given)


class NotComparableError(ValueError):
    """Of what a scenario gives, nothing is known of the unit so far."""

    def __init__(self, what: str) -> None:
        super().__init__(
            f"{what} is not known, with which the scenario is compared: growth is counted by hours"
        )


def _in_words(shares: Mapping[float, float], unit: str) -> str:
    parts = (f"{100.0 * share:.3g} % at {value:g}{unit}" for value, share in shares.items())
    return " and ".join(parts)


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


def check_scenarios(scenarios: tuple[Scenario, ...]) -> tuple[Scenario, ...]:
    """Return scenarios that can be answered at once.

    Raises
    ------
    ValueError
        When there are too many, or two of one name.
    """
    if len(scenarios) > MOST_SCENARIOS:
        raise ValueError(f"{len(scenarios)} scenarios: expected at most {MOST_SCENARIOS}")
    names = [one.name for one in scenarios]
    for name in names:
        if (times := names.count(name)) > 1:
            raise ValueError(f"name = {name!r}: expected once, it is given {times} times")
    return scenarios


def read_scenarios(path: Path) -> tuple[Scenario, ...]:
    """Return the scenarios in a YAML file.

    Raises
    ------
    ValueError
        When it is none of scenarios; the message names file, scenario, key and value.
    OSError
        When it cannot be read.
    """
    content = load_yaml(path)
    try:
        if not isinstance(content, dict) or set(content) != {"scenarios"}:
            named = ", ".join(map(str, content)) if isinstance(content, dict) else str(content)
            raise ValueError(f"{named[:80]}: expected one key, scenarios")
        rows = content["scenarios"]
        if not isinstance(rows, list) or not rows:
            raise ValueError(f"scenarios = {str(rows)[:80]}: expected a list of at least one")
        return check_scenarios(tuple(_scenario(number, row) for number, row in enumerate(rows, 1)))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _scenario(number: int, row: Any) -> Scenario:
    if not isinstance(row, dict):
        raise ValueError(f"scenario {number} = {str(row)[:80]}: expected keys with values")
    known = [item.name for item in fields(Scenario)]
    try:
        for key in row:
            if key not in known:
                raise ValueError(unknown_name("key", key, known))
        return Scenario(**row)
    except ValueError as error:
        raise ValueError(f"scenario {number}: {error}") from error
