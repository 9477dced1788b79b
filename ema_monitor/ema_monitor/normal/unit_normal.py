"""The tests of a unit that its owner has named, in a file, and what they say of a later test."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Self

import yaml

from ema_core.files import complete_file
from ema_core.yaml_file import load_yaml
from ema_monitor.normal.features import FEATURES, TOLERANCE, Motion, Part, mean_of
from ema_monitor.normal.normal import FEWEST_TESTS, Departure, HealthyTest, Normal
from ema_monitor.normal.states import LabelledTest, States, by_state

HEALTHY: Final = "healthy"
"""State of the tests that are the unit's normal."""

_FORMAT: Final = 1


@dataclass(frozen=True)
class NamedTest:
    """A test of a unit, read from a source, and what its owner says of it.

    The state is ``HEALTHY``, or what is wrong with the unit; the condition is what telemetry does
    not tell and has to be alike, such as a load. The stamp is that of the first sample [ns].

    Raises
    ------
    ValueError
        When it has no part, or a figure is unknown.
    """

    source: str
    actuator_id: str
    serial_number: str
    stamp_ns: int
    state: str
    condition: str
    parts: tuple[Part, ...]

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError(f"{self.source}: expected a stretch of motion at least")
        for part in self.parts:
            if unknown := part.features.keys() - FEATURES.keys():
                raise ValueError(f"{self.source}: unknown figures {', '.join(sorted(unknown))}")

    @property
    def motion(self) -> Motion:
        """What was commanded."""
        return mean_of(self.parts)[0]

    @property
    def as_test(self) -> HealthyTest:
        """Its time and the means of its figures."""
        return HealthyTest(self.stamp_ns, mean_of(self.parts)[1])

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values."""
        parts = [
            {"motion": asdict(one.motion), "samples": one.samples, "features": one.features}
            for one in self.parts
        ]
        return {**{name: getattr(self, name) for name in _PLAIN}, "parts": parts}

    @classmethod
    def of_mapping(cls, content: dict[str, Any]) -> Self:
        """Return what `as_mapping` gives."""
        parts = tuple(
            Part(Motion(**one["motion"]), dict(one["features"]), int(one["samples"]))
            for one in content["parts"]
        )
        return cls(**{name: content[name] for name in _PLAIN}, parts=parts)


_PLAIN: Final = ("source", "actuator_id", "serial_number", "stamp_ns", "state", "condition")


@dataclass(frozen=True)
class Checked:
    """What is said of a test.

    The departure is None where nothing like it is known, for this ``reason``. ``states`` are the
    probabilities of each state that was named, and of none of them, the largest first; empty where
    fewer than two states are known.
    """

    departure: Departure | None
    states: dict[str, float]
    reason: str = ""

    @property
    def departed(self) -> bool:
        """Whether the test departs from the healthy ones."""
        return self.departure is not None and self.departure.is_significant

    def __str__(self) -> str:
        if self.departure is None:
            return f"refused: {self.reason}"
        words = str(self.departure)
        if self.departure.remark:
            words += f" ({self.departure.remark})"
        if self.states and self.departed:
            words += "; named: " + ", ".join(
                f"{name} {share:.0%}" for name, share in self.states.items() if share >= 0.05
            )
        return words


class UnitNormal:
    """What is known of the normal of one unit, by its tests."""

    def __init__(self, tests: Sequence[NamedTest] = ()) -> None:
        self.tests: list[NamedTest] = []
        for test in tests:
            self.add(test)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file.

        Raises
        ------
        ValueError
            When it is none of this format.
        OSError
            When it cannot be read.
        """
        content = load_yaml(path)
        try:
            if content["format"] != _FORMAT:
                raise ValueError(f"format = {content['format']!r}: expected {_FORMAT}")
            return cls([NamedTest.of_mapping(one) for one in content["tests"]])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path} holds no tests of a unit's normal: {error}") from error

    def save(self, path: Path) -> None:
        """Write a file; an existing one is replaced once it is complete."""
        content = {"format": _FORMAT, "tests": [one.as_mapping() for one in self.tests]}
        with complete_file(path) as partial:
            partial.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None))

    def add(self, test: NamedTest) -> None:
        """Add a test; one of the same time, state and condition takes the place of the earlier.

        Raises
        ------
        ValueError
            When it is of another unit.
        """
        self._check_unit(test)
        self.tests = [one for one in self.tests if not _is_same(one, test)]
        self.tests.append(test)

    def check(self, test: NamedTest) -> Checked:
        """Return what is said of a test; it is not counted among those that it is judged by.

        Raises
        ------
        ValueError
            When it is of another unit.
        """
        self._check_unit(test)
        others = [one for one in self.tests if not _is_same(one, test)]
        alike = [one for one in others if one.condition == test.condition]
        near = [one for one in alike if not one.motion.mismatch(test.motion, TOLERANCE)]
        healthy = [one.as_test for one in near if one.state == HEALTHY]
        if len(healthy) < FEWEST_TESTS:
            return Checked(None, {}, self._why_not(test, alike, len(healthy)))
        departure = Normal(healthy).departure(test.as_test)
        labelled = [
            LabelledTest(one.state, one.as_test, [part.features for part in one.parts])
            for one in near
        ]
        is_enough = [len(one) >= FEWEST_TESTS for one in by_state(labelled).values()]
        states = States(labelled).probabilities(test.as_test) if sum(is_enough) > 1 else {}
        return Checked(departure, states)

    def _why_not(self, test: NamedTest, alike: Sequence[NamedTest], healthy: int) -> str:
        if not alike:
            known = sorted({one.condition or "none" for one in self.tests}) or ["none"]
            return (
                f"no test under the condition {test.condition or 'none'!r} is known; known: "
                f"{', '.join(known)}"
            )
        differs = [one.motion.mismatch(test.motion, TOLERANCE) for one in alike]
        if all(differs):
            return f"outside the known motion: {min(differs, key=len)} the nearest test"
        return (
            f"{healthy} healthy tests of this motion and condition: expected {FEWEST_TESTS} or more"
        )

    def _check_unit(self, test: NamedTest) -> None:
        if self.tests and self.tests[0].serial_number != test.serial_number:
            raise ValueError(
                f"{test.source} is of unit {test.serial_number!r}, the normal of "
                f"{self.tests[0].serial_number!r}: a normal holds for one unit"
            )


def _is_same(one: NamedTest, other: NamedTest) -> bool:
    return (one.source, one.stamp_ns) == (other.source, other.stamp_ns)
