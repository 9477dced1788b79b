# SPDX-License-Identifier: Apache-2.0
"""Displayed names of faults, hidden causes, required performances and kinds of events."""

from typing import Final

from ema_core.causes import CAUSES
from ema_core.faults import FAULTS

_LABELS: Final = {item.name: item.label for item in (*FAULTS, *CAUSES)} | {
    "torque_per_ampere": "torque per unit of effort"
}


def label_of(name: str) -> str:
    """Return the label of a fault, hidden cause, required performance, figure or kind.

    Quantities of a joint have their labels in ``ema_monitor.quantities``.
    """
    return _LABELS.get(name) or name.replace("_", " ")
