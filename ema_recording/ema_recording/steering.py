"""Services that pause, step, speed up and move a playback, and the state that tells of it.

They have the names of rosbag2's player and the fields of its requests; their types are our own,
whose answers say why something is refused.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

from rclpy.node import Node
from std_srvs.srv import Trigger

from ema_interfaces.msg import PlaybackState
from ema_interfaces.srv import (
    BurstPlayback,
    GetPlaybackRate,
    IsPlaybackPaused,
    SeekPlayback,
    SetPlaybackRate,
)
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.topics import LATCHED, PLAYBACK_STATE

Act = Callable[[Any], Mapping[str, Any] | None]
"""Does what a request asks, and gives fields of the answer; ValueError or OSError if impossible."""

_KINDS: Final = {
    "pause": Trigger,
    "resume": Trigger,
    "toggle_paused": Trigger,
    "is_paused": IsPlaybackPaused,
    "play_next": Trigger,
    "burst": BurstPlayback,
    "get_rate": GetPlaybackRate,
    "set_rate": SetPlaybackRate,
    "seek": SeekPlayback,
}


class Steering:
    """The services ``~/pause`` and so on, and ``playback_state``.

    Parameters
    ----------
    acts
        What is done for each service, by its name.
    """

    def __init__(self, node: Node, acts: dict[str, Act]) -> None:
        self._node = node
        group = WaitingCallbackGroup()  # a seek reads the bag
        self._services = [
            node.create_service(
                _KINDS[name], f"~/{name}", self._answerer(act), callback_group=group
            )
            for name, act in acts.items()
        ]
        self._output = node.create_publisher(PlaybackState, PLAYBACK_STATE, LATCHED)

    def publish(self, state: PlaybackState) -> None:
        """Publish how the playback stands."""
        state.header.stamp = self._node.get_clock().now().to_msg()
        self._output.publish(state)

    def close(self) -> None:
        """Serve no more."""
        for service in self._services:
            self._node.destroy_service(service)
        self._node.destroy_publisher(self._output)

    def _answerer(self, act: Act) -> Callable[[Any, Any], Any]:
        def answer(request: Any, response: Any) -> Any:
            try:
                fields = act(request)
            except (OSError, ValueError) as error:
                response.message = str(error)
                return response
            if fields is None:
                fields = {"success": True}
            for name, value in fields.items():
                setattr(response, name, value)
            return response

        return answer
