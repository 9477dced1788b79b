# SPDX-License-Identifier: Apache-2.0
"""Generate docs/parameters.md from parameter declarations: ``python tools/parameter_page.py``."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.context import Context

from ema_cli.processes.bringup import NODES, node_class
from ema_core.faults import FAULT_NAMES
from ema_ros.node_parameters import AT_CONFIGURE, LIVE

PAGE: Final = Path("docs/parameters.md")

_HEAD: Final = """# Parameters

Generated from the declarations by `make parameters`; `ros2 param describe NODE NAME` prints the
same information for a running node. `-p NAME:=VALUE` and parameter files set them at startup
([nodes.md](nodes.md#parameters)).

- **live**: can be changed at any time, and takes effect at the next identified window. If the
  definition of a window changes, the node refuses the current window.
- **configure**: can be changed while the node is unconfigured or inactive, and takes effect at the
  next configure. An active node refuses it: deactivate the node, set the parameter, then clean up,
  configure and activate. A node that is activated without this step reports the parameter as a
  warning in its status `lifecycle`.
- **unconfigured**: can be changed while the node is unconfigured.
- **start**: can only be set at startup.

FAULT stands for the name of each [fault](faults.md#the-fault-vector), as in
`growth.friction.law`. The defaults of `plant` describe the built-in actuator; with `actuator_file`,
they are the values of the file.
"""
# A separate page documents each fault.
_FOLDED: Final = {"faults.": "| `faults.FAULT` | healthy |  | configure | initial fault |"}
_FAULTS: Final = "|".join(FAULT_NAMES)
_SIM_TIME: Final = "use /clock instead of the system clock"
_CHANGES: Final = {LIVE: "live", AT_CONFIGURE: "configure"}


def parameter_page() -> str:
    """Return the content of docs/parameters.md."""
    rows = {name: list(dict.fromkeys(_rows(name))) for name in NODES}
    shared = [row for row in rows["monitor"] if all(row in of_node for of_node in rows.values())]
    lines = [_HEAD]
    for name, section in {"all nodes": shared, **rows}.items():
        lines += [f"## {name}", "", "| parameter | default | values | change | meaning |"]
        kept = [row for row in section if section is shared or row not in shared]
        lines += ["|---|---|---|---|---|", *kept, ""]
    return "\n".join(lines)


def _rows(name: str) -> Iterator[str]:
    context = Context()
    rclpy.init(context=context, args=[])
    try:
        node = node_class(name)(context=context)
        names = sorted(node.list_parameters([], 0).names, key=lambda item: (item.count("."), item))
        for item in names:
            yield _row(node.describe_parameter(item), node.get_parameter(item).value)
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)


def _row(descriptor: ParameterDescriptor, value: Any) -> str:
    for prefix, folded in _FOLDED.items():
        if descriptor.name.startswith(prefix):
            return folded
    meaning, unit = descriptor.description or _SIM_TIME, ""
    if meaning.endswith("]") and (descriptor.floating_point_range or descriptor.integer_range):
        meaning, _, unit = meaning[:-1].rpartition(" [")
    constraint, _, values = descriptor.additional_constraints.partition("one of ")
    for limits in (*descriptor.floating_point_range, *descriptor.integer_range):
        values = f"{limits.from_value:g} to {limits.to_value:g} {unit}".removesuffix(" -")
    change = _CHANGES.get(constraint.removesuffix("; "), "start")
    if descriptor.name == "use_sim_time":
        change = "unconfigured"
    # All faults have the same parameters.
    name = re.sub(rf"^(growth|known_law)\.({_FAULTS})\b", r"\1.FAULT", descriptor.name)
    cells = (f"`{name}`", f"`{json.dumps(value)}`", values, change, meaning)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(parameter_page(), encoding="utf-8")
