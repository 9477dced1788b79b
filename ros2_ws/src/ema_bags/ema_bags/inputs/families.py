# SPDX-License-Identifier: Apache-2.0
"""Grouping of table columns by joint, from a part of their names that changes with the joint."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from ema_bags.inputs.names import roles_of, unit_in_name
from ema_bags.inputs.recognition import Hint

JOINT: Final = "{joint}"
"""Placeholder of the joint in a column name."""

_TOKENS: Final = re.compile(r"[\[(][^\])]*[\])]|[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_MOST_TOKENS: Final = 4
_SIDES: Final = frozenset(
    (
        *("motor", "joint", "link", "load", "output", "input", "gear", "shaft", "user", "drive"),
        *("act", "actual", "meas", "measured", "raw", "filtered", "filt", "fb", "feedback", "est"),
        *("min", "max", "mean", "std", "abs", "rel", "old", "new", "in", "out", "high", "low"),
    )
)
"""Words that distinguish two values of one joint rather than two joints."""


@dataclass(frozen=True)
class JointNames:
    """Columns of one joint."""

    joint: str
    """Part of the names that denotes the joint; empty if the table has one joint."""

    columns: Mapping[str, str]
    """Column names, keyed by template, such as ``actual_q_{joint}``."""


def joint_names(names: Sequence[str], hint_of: Callable[[str], Hint]) -> list[JointNames]:
    """Return the columns of each joint; empty if the names do not distinguish joints.

    A template is a column name in which ``{joint}`` replaces a word or number. All columns of a
    template suggest the same quantity, and one template suggests a measured position.

    Parameters
    ----------
    names
        Column names, without the clock.
    hint_of
        Function that returns the hint for a column name.
    """
    joints: list[JointNames] = []
    remaining = list(names)
    while True:
        family = _best_family(remaining, hint_of)
        if family is None:
            return joints
        joints += family
        used = {column for item in family for column in item.columns.values()}
        remaining = [name for name in remaining if name not in used]


def _best_family(names: Sequence[str], hint_of: Callable[[str], Hint]) -> list[JointNames] | None:
    hints = {name: hint_of(name) for name in names}
    templates: dict[str, dict[str, str]] = {}
    for name in names:
        for template, key in _splits(name):
            templates.setdefault(template, {})[key] = name
    valid = {
        template: columns
        for template, columns in templates.items()
        if len(columns) > 1 and len({hints[name] for name in columns.values()}) == 1
    }
    best: tuple[tuple[int, ...], dict[str, dict[str, str]]] | None = None
    for template, columns in valid.items():
        hint = hints[next(iter(columns.values()))]
        if "position" not in hint.quantities or hint.is_commanded:
            continue
        family = _family(template, valid)
        covered = sum(map(len, family.values()))
        numbers = sum(key.isdigit() for key in columns)
        shortest = -sum(map(len, columns))
        score = (covered, len(columns), numbers, shortest)
        if best is None or score > best[0]:
            best = score, family
    if best is None:
        return None
    by_joint: dict[str, dict[str, str]] = {}
    for template, columns in best[1].items():
        for key, name in columns.items():
            by_joint.setdefault(key, {})[template] = name
    order = {name: number for number, name in enumerate(names)}
    joints = [JointNames(key, columns) for key, columns in by_joint.items()]
    return sorted(joints, key=lambda item: min(order[name] for name in item.columns.values()))


def _family(seed: str, valid: Mapping[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    """Return the template ``seed`` and the templates with no other joints, with their columns.

    ``valid`` has the column of each joint, by template. No two returned templates share a column.
    """
    keys, family = valid[seed].keys(), {seed: valid[seed]}
    used = set(valid[seed].values())
    longest_first = sorted(valid.items(), key=lambda item: -len(item[1]))
    for template, columns in longest_first:
        if columns.keys() <= keys and not used & set(columns.values()):
            family[template] = columns
            used |= set(columns.values())
    return family


def _splits(name: str) -> Iterator[tuple[str, str]]:
    """Yield each template of a column name, with the joint name that it replaces."""
    tokens = [match for match in _TOKENS.finditer(name) if match[0][0] not in "[("]
    unit = unit_in_name(name)
    for first in range(len(tokens)):
        for last in range(first, min(len(tokens), first + _MOST_TOKENS)):
            start, end = tokens[first].start(), tokens[last].end()
            key, remainder = name[start:end], name[:start] + name[end:]
            if "[" in key or "(" in key or not re.search(r"[A-Za-z]", remainder):
                continue
            if unit and last == len(tokens) - 1 and not key.isdigit():
                continue
            if _is_joint(key):
                yield name[:start] + JOINT + name[end:], key


def _is_joint(key: str) -> bool:
    """Return whether a part of a name can denote a joint rather than a quantity."""
    if key.isdigit():
        return True
    words = [match[0].lower() for match in _TOKENS.finditer(key)]
    if all(word in _SIDES for word in words):
        return False
    # A single letter, such as X or J, may denote an axis although it also abbreviates a quantity.
    return (len(key) == 1 and key.isupper()) or not roles_of(key)
