# SPDX-License-Identifier: Apache-2.0
"""Time profiles of hidden causes (constant, step or ramp), and their notation as strings."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema_core.causes import CAUSE_BY_NAME, Cause, SystemPart
from ema_core.quantity import is_finite_number
from ema_core.wording import as_identifier, unknown_name

GRAMMAR: Final = "NAME=VALUE[@START[..END]]"
"""Notation of a cause: value, then optionally the time of a step, or start and end of a ramp
[s]."""

_TEXT: Final = re.compile(r"\s*([^=]+?)\s*=\s*([^@=\s]+?)(?:@([^@=\s]+?)(?:\.\.([^@=\s]+))?)?\s*")


@dataclass(frozen=True)
class Profile:
    """Time profile of a cause: 0 until ``start_s``, then a ramp to ``value`` at ``end_s``."""

    value: float
    """Final value, in the unit of the cause."""
    start_s: float = 0.0
    """Start of the ramp, relative to the time at which the cause is set [s]."""
    end_s: float = 0.0
    """End of the ramp [s]; equal to ``start_s`` for a step."""

    def at(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Return the value of the cause at ``time_s``, with the shape of ``time_s``."""
        t = np.asarray(time_s, dtype=np.float64)
        if self.end_s == self.start_s:
            return np.where(t >= self.start_s, self.value, 0.0)
        return self.value * np.clip((t - self.start_s) / (self.end_s - self.start_s), 0.0, 1.0)

    def __str__(self) -> str:
        if self.end_s > self.start_s:
            return f"{self.value:g}@{self.start_s:g}..{self.end_s:g}"
        return f"{self.value:g}@{self.start_s:g}" if self.start_s else f"{self.value:g}"


Causes = Mapping[str, Profile | float] | Iterable[str]
"""Values or profiles keyed by the name of the cause, or strings in the notation `GRAMMAR`."""


def cause_profiles(causes: Causes) -> dict[str, Profile]:
    """Return hidden causes as profiles, keyed by name, after validation.

    Parameters
    ----------
    causes
        Values or profiles keyed by name, or strings such as ``"current_offset=0.1@3.0"``
        (`GRAMMAR`). A value is constant from time 0.

    Raises
    ------
    ValueError
        If a name is unknown or repeated, a value is not a number in its range, or a time is
        negative or not finite; the message names the cause, its value, unit and range.
    """
    if isinstance(causes, str) or not isinstance(causes, Iterable):
        raise ValueError(f"causes = {causes!r}: expected a list of strings {GRAMMAR}")
    if isinstance(causes, Mapping):
        pairs = [
            (name, item if isinstance(item, Profile) else Profile(item))
            for name, item in causes.items()
        ]
    else:
        pairs = [_parsed(text) for text in causes]
    profiles: dict[str, Profile] = {}
    for name, profile in pairs:
        cause = _cause(name)
        if cause.name in profiles:
            raise ValueError(f"hidden cause {cause.name} is given more than once")
        profiles[cause.name] = _checked(cause, profile)
    return profiles


def _parsed(text: str) -> tuple[str, Profile]:
    match = _TEXT.fullmatch(text) if isinstance(text, str) else None
    if match is None:
        raise ValueError(f"hidden cause {text!r}: expected {GRAMMAR}")
    name, *number_texts = match.groups()
    cause = _cause(name)
    numbers = []
    for what, number, unit in zip(
        (f"{cause.name} =", "start", "end"), number_texts, (cause.unit, "s", "s"), strict=True
    ):
        try:
            numbers.append(None if number is None else float(number))
        except ValueError:
            quoted = f"{what} {number} {unit if unit != '-' else ''}".rstrip()
            raise ValueError(
                f"hidden cause {text!r}: {quoted} is not a number; expected {GRAMMAR}"
            ) from None
    value, start, end = numbers
    start = 0.0 if start is None else start
    if end is not None and end <= start:
        raise ValueError(
            f"hidden cause {text!r}: the ramp's end {end:g} s is not after its start {start:g} s"
        )
    return name, Profile(value, start, start if end is None else end)


def _cause(name: str) -> Cause:
    cause = CAUSE_BY_NAME.get(as_identifier(name))
    if cause is None:
        raise ValueError(unknown_name("hidden cause", name, CAUSE_BY_NAME))
    return cause


def _checked(cause: Cause, profile: Profile) -> Profile:
    """Return the profile with float values; raise ValueError if it is invalid for its cause."""
    value, unit = profile.value, cause.unit
    expected = f"[{cause.lowest:g}, {cause.highest:g}] {unit} ({cause.label}: {cause.meaning})"
    if not is_finite_number(value):
        raise ValueError(f"{cause.name} = {value!r}: expected a finite number in {expected}")
    if not cause.lowest <= value <= cause.highest:
        raise ValueError(f"{cause.name} = {value:g} {unit} is outside {expected}")
    for name, time_s in (("start", profile.start_s), ("end", profile.end_s)):
        if not is_finite_number(time_s) or time_s < 0.0:
            raise ValueError(
                f"{cause.name}: {name} = {time_s!r} s: expected a finite number of at least 0 s"
            )
    if profile.end_s < profile.start_s:
        raise ValueError(
            f"{cause.name}: end = {profile.end_s:g} s is before start = {profile.start_s:g} s"
        )
    if cause.place is SystemPart.DEFECT:
        if value not in (0.0, 1.0):
            raise ValueError(f"{cause.name} = {value:g}: expected 0 or 1 ({cause.meaning})")
        if profile.end_s > profile.start_s:
            raise ValueError(f"{cause.name}: a defect begins at once, without a ramp")
    return Profile(float(value), float(profile.start_s), float(profile.end_s))
