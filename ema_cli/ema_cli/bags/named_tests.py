"""A bag as one test: the figures of its telemetry."""

from pathlib import Path
from typing import Any, Final

from ema_bags.reader import Bag
from ema_bags.telemetry import read_telemetry
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry, join
from ema_monitor.normal.features import parts_of
from ema_monitor.normal.unit_normal import Checked, NamedTest

_MOST_SAMPLES: Final = 500_000


def read_test(bag: Path, actuator_id: str | None, state: str, condition: str) -> NamedTest:
    """Return what a bag shows; its name, and that of its folder, is the source of the test."""
    recorded = read_telemetry(Bag(bag), None, actuator_id)
    description: ActuatorDescription | None = None
    parts: list[list[Telemetry]] = []
    for _, item in recorded.items():
        if isinstance(item, ActuatorDescription):
            if description is not None and item.unit_key != description.unit_key:
                raise ValueError(f"{bag} holds tests of several units: give a bag for each")
            description = item
        elif isinstance(item, Telemetry):
            latest = parts[-1] if parts else []
            goes_on = latest and item.first_index == latest[-1].first_index + len(latest[-1])
            if goes_on and sum(map(len, latest)) + len(item) <= _MOST_SAMPLES:
                latest.append(item)
            else:
                parts.append([item])
    if not parts or description is None:
        raise ValueError(f"{bag} has no {'description' if parts else 'telemetry'} of the actuator")
    try:
        figures = tuple(parts_of(map(join, parts)))
    except ValueError as error:
        raise ValueError(f"{bag}: {error}") from error
    return NamedTest(
        str(bag.absolute()),
        description.actuator_id,
        description.serial_number,
        parts[0][0].stamp_ns,
        state,
        condition,
        figures,
    )


def as_mapping(checked: Checked) -> dict[str, Any]:
    """Return what is said of a test in plain values."""
    departure = checked.departure
    changes = [
        {"name": one.name, "healthy": one.healthy, "value": one.value, "z": one.z}
        for one in (departure.changes if departure else ())
    ]
    return {
        "departed": departure.is_significant if departure else None,
        "probability": departure.probability if departure else None,
        "changes": changes,
        "states": checked.states,
        "reason": checked.reason or (departure.remark if departure else ""),
    }
