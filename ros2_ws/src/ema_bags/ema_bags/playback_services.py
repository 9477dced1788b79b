# SPDX-License-Identifier: Apache-2.0
"""Types of the player's services: types of ``rosbag2_interfaces`` if it is installed.

Otherwise they are types of ``ema_interfaces`` and ``std_srvs`` with the same fields, and with
``success`` and ``message`` in the response of a service that can be refused.
"""

from collections.abc import Mapping
from typing import Any, Final

from std_srvs.srv import Trigger

from ema_interfaces import srv as copies


def _types() -> Mapping[str, Any]:
    try:
        from rosbag2_interfaces import srv  # pyright: ignore[reportMissingImports]
    except ImportError:
        return {
            **dict.fromkeys(("pause", "resume", "toggle_paused", "play_next"), Trigger),
            "is_paused": copies.IsPlaybackPaused,
            "burst": copies.BurstPlayback,
            "get_rate": copies.GetPlaybackRate,
            "set_rate": copies.SetPlaybackRate,
            "seek": copies.SeekPlayback,
        }
    return {
        "pause": srv.Pause,
        "resume": srv.Resume,
        "toggle_paused": srv.TogglePaused,
        "play_next": srv.PlayNext,
        "is_paused": srv.IsPaused,
        "burst": srv.Burst,
        "get_rate": srv.GetRate,
        "set_rate": srv.SetRate,
        "seek": srv.Seek,
    }


PLAYBACK_SERVICES: Final = _types()
"""Type of each service of the player by its name, relative to the node."""
