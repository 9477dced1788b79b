"""Write what the page has to know of faults, hidden causes, quantities and messages.

Run by ``make page``; tests/web compares the files with the registries and definitions.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray

from ema_bags.message_type import message_class
from ema_core.causes import CAUSE_BY_NAME
from ema_core.faults import FAULTS
from ema_interfaces import msg
from ema_monitor.joint.comparison import QUANTITIES

WEB: Final = Path(__file__).parents[1] / "ros2_ws/src/ema_dashboard/web"
FILE: Final = WEB / "src/registry.json"
INTERFACES: Final = FILE.with_name("interfaces.ts")

_READ: Final = (
    *(msg.ActuatorDescription, msg.Advice, msg.BaselineStatus, DiagnosticArray),
    *(msg.FaultEstimate, msg.FrictionCurve, msg.Health, msg.HealthForecast, msg.PlaybackState),
    *(msg.TelemetryBlock, msg.UnitHistory, msg.WindowFit),
)
_SIMPLE: Final = {"string": "string", "boolean": "boolean", "int64": "bigint", "uint64": "bigint"}
_NUMBERS: Final = ("double", "float", "octet", "uint8", "int32", "uint32")
_ARRAYS: Final = {"double": "Float64Array", "float": "Float32Array"}


def registry() -> dict[str, Any]:
    """Return names, words and scales of faults, and words of hidden causes and quantities."""
    faults = [
        {
            "name": one.name,
            "label": one.label,
            "healthy": one.healthy,
            "highest": one.highest,
            "twoSided": one.is_two_sided,
            "assessed": one.limit is not None,
            "quantity": one.quantity,
            "base": one.base,
            "slope": one.slope,
            "unit": one.unit,
        }
        for one in FAULTS
    ]
    return {
        "faults": faults,
        "causes": {name: cause.label for name, cause in CAUSE_BY_NAME.items()},
        "quantities": {
            name: {"label": one.label, "reference": one.reference}
            for name, one in QUANTITIES.items()
        },
    }


def interfaces() -> str:
    """Return the messages that the page reads as types of TypeScript, by their definitions."""
    head = "// Written by `make page` of the definitions of the messages.\n"
    return head + "".join(text for _, text in sorted(_types(_READ, {}).items()))


def _types(classes: Any, known: dict[str, str]) -> dict[str, str]:
    """Return the types of messages and of what they contain, by their names."""
    for one in classes:
        if one.__name__ in known:
            continue
        fields = one.get_fields_and_field_types()
        known[one.__name__] = ""
        _types(_contained(fields.values()), known)
        if set(fields.values()) == {"double"}:
            # Such as a vector of faults, which are read by their names.
            known[one.__name__] = f"\nexport type {one.__name__} = Record<string, number>;\n"
            continue
        lines = [f"  {name}: {_type(kind)};" for name, kind in fields.items()]
        body = "\n".join(lines)
        known[one.__name__] = f"\nexport interface {one.__name__} {{\n{body}\n}}\n"
    return known


def _contained(kinds: Any) -> Iterator[Any]:
    for kind in kinds:
        found = re.search(r"(\w+)/(\w+)", kind)
        if found:
            yield message_class(f"{found[1]}/msg/{found[2]}")


def _type(kind: str) -> str:
    many = re.fullmatch(r"sequence<(.*)>|(.*)\[\d+\]", kind)
    if many:
        item = many[1] or many[2]
        return _ARRAYS.get(item) or f"{_type(item)}[]"
    return "number" if kind in _NUMBERS else _SIMPLE.get(kind) or kind.rpartition("/")[2]


if __name__ == "__main__":
    FILE.write_text(json.dumps(registry(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    INTERFACES.write_text(interfaces(), encoding="utf-8")
