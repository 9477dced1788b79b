# SPDX-License-Identifier: Apache-2.0
"""The layouts for Foxglove, Lichtblick and PlotJuggler refer to existing topics and fields."""

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from ament_index_python.packages import get_package_share_directory

from ema_bags.message_type import message_class
from ema_dashboard.known_topics import known_topics

FOLDER = Path(get_package_share_directory("ema_dashboard"), "layouts")
CLASSES = {topic.name: topic.message_class for topic in known_topics(["/ema"])}
NUMBERS = {"float", "double"} | {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 32, 64)}
_TEXTS = {"topicPath", "topicToRender"}


def field_type(kind: Any, names: list[str]) -> str:
    """Return the type of the field at a path; KeyError if it does not exist."""
    for number, name in enumerate(names):
        declared = kind.get_fields_and_field_types()[re.sub(r"\[[\d:]*\]$", "", name)]
        element = re.fullmatch(r"(?:sequence<)?([\w/]+)(?:, \d+)?(?:>|\[\d+\])?", declared)
        assert element is not None, declared
        if element[1] != declared:
            assert name.endswith("]"), f"{name} is a sequence, {declared}"
        if number + 1 == len(names):
            return element[1]
        package, short = element[1].split("/")
        kind = message_class(f"{package}/msg/{short}")
    return ""


def studio_paths(name: str) -> Iterator[str]:
    """Yield the paths in a layout of Foxglove or Lichtblick."""
    panels = json.loads((FOLDER / name).read_text())["configById"]
    for panel in panels.values():
        yield from (path["value"] for path in panel.get("paths", []))
        yield from (panel[key] for key in _TEXTS & panel.keys())


@pytest.mark.parametrize("name", ["foxglove.json", "lichtblick.json"])
def test_paths_of_a_studio_layout_exist(name):
    paths = list(studio_paths(name))
    assert len(paths) > 10
    for path in paths:
        topic, *fields = path.split(".")
        assert not fields or field_type(CLASSES[topic], fields) in NUMBERS, path
        assert topic in CLASSES


def test_curves_of_the_plotjuggler_layout_exist():
    tree = ElementTree.parse(FOLDER / "plotjuggler.xml")
    curves = [curve.attrib["name"] for curve in tree.iter("curve")]
    assert len(curves) > 10
    for curve in curves:
        topic = "/".join(curve.split("/")[:3])
        assert field_type(CLASSES[topic], curve.split("/")[3:]) in NUMBERS, curve
