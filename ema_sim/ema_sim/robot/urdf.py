# SPDX-License-Identifier: Apache-2.0
"""Robot description of the simulated arm."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from math import pi
from typing import Final

from ema_sim.robot.joint import SimulatedJoint, controller_of

# Origin of each joint in its parent link [m], and its axis.
_GEOMETRY: Final = (
    ("0 0 0.10", "0 0 1"),
    ("0 0 0.08", "0 1 0"),
    ("0 0 0.42", "0 1 0"),
    ("0 0 0.39", "0 1 0"),
    ("0 0 0.08", "0 0 1"),
    ("0 0 0.08", "0 1 0"),
)


def robot_description(joints: Mapping[str, SimulatedJoint], name: str = "arm") -> str:
    """Return the URDF of the arm: a chain of links with limits of position, speed and effort."""
    root = ElementTree.Element("robot", name=name)
    parent = "stand"  # base_link is the link that the joint "base" turns
    ElementTree.SubElement(root, "link", name=parent)
    for (joint_name, joint), (origin, axis) in zip(joints.items(), _GEOMETRY, strict=True):
        child = f"{joint_name}_link"
        ElementTree.SubElement(root, "link", name=child)
        item = ElementTree.SubElement(root, "joint", name=joint_name, type="revolute")
        ElementTree.SubElement(item, "origin", xyz=origin, rpy="0 0 0")
        ElementTree.SubElement(item, "parent", link=parent)
        ElementTree.SubElement(item, "child", link=child)
        ElementTree.SubElement(item, "axis", xyz=axis)
        ElementTree.SubElement(
            item,
            "limit",
            lower=f"{-pi:.4f}",
            upper=f"{pi:.4f}",
            effort=f"{controller_of(joint).limit:.1f}",
            velocity=f"{2.0 * joint.speed:g}",
        )
        parent = child
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
