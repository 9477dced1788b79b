"""Conversion of ema_interfaces/MeasuredCauses to stamp and measured causes."""

from typing import TYPE_CHECKING

from ema_core.causes import CAUSE_BY_NAME, CauseEstimate
from ema_ros.stamps import stamp_from_message

if TYPE_CHECKING:
    from ema_interfaces.msg import MeasuredCauses


def measured_from_message(message: "MeasuredCauses") -> tuple[int, list[CauseEstimate]]:
    """Return when causes were measured [ns], and what they are; their values are not checked.

    Raises
    ------
    ValueError
        When there is no stamp, or a unit is not that of the registry.
    """
    stamp_ns = stamp_from_message(message.header.stamp)
    if stamp_ns <= 0:
        raise ValueError(f"stamp = {stamp_ns} ns: expected the time of the measurement")
    for one in message.causes:
        cause = CAUSE_BY_NAME.get(one.name)
        if cause and one.unit not in ("", cause.unit):
            raise ValueError(
                f"measured cause {one.name}: unit = {one.unit!r}: expected {cause.unit!r}"
            )
    return stamp_ns, [CauseEstimate(one.name, one.value, one.sigma) for one in message.causes]
