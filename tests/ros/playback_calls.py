# SPDX-License-Identifier: Apache-2.0
"""Calls of a player's services, whose types are of ema_interfaces or of rosbag2.

Types of ema_interfaces have the fields ``success`` and ``message``.
"""

from typing import Any

from ema_bags.playback_services import PLAYBACK_SERVICES

from .spinning import Spinning


def ask(graph: Spinning, name: str, **fields: Any) -> Any:
    """Call a service of the player and return its answer."""
    return graph.call(PLAYBACK_SERVICES[name], f"player/{name}", **fields)


def check_done(answer: Any) -> None:
    """Check that a service succeeded, if its type has a field for success."""
    assert getattr(answer, "success", True), answer


def check_refused(answer: Any, reason: str) -> None:
    """Check that a service refused, with its reason if its type has fields for both."""
    assert not getattr(answer, "success", False)
    assert reason in getattr(answer, "message", reason)
