# SPDX-License-Identifier: Apache-2.0
"""Mappings that several joints of a source share."""

from collections.abc import Iterable
from dataclasses import replace

from ema_bags.inputs.mapping import ColumnMapping


def shared_mappings(mappings: Iterable[ColumnMapping]) -> tuple[ColumnMapping, ...]:
    """Combine mappings that differ only in ``joint``, in order of decreasing number of joints.

    Parameters
    ----------
    mappings
        Mapping of each joint; ``{joint}`` in a source stands for the joint's name.
    """
    groups: dict[str, tuple[ColumnMapping, list[str]]] = {}
    for mapping in mappings:
        of_any = replace(mapping, joint="joint") if mapping.joint else mapping
        groups.setdefault(repr(of_any), (mapping, []))[1].append(mapping.joint)
    ordered = sorted(groups.values(), key=lambda group: -len(set(group[1])))
    return tuple(
        replace(mapping, joint="", joints=tuple(dict.fromkeys(names)))
        if len(set(names)) > 1
        else mapping
        for mapping, names in ordered
    )
