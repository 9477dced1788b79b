"""Services by which a playback is paused, sped up and moved, and the state that tells of it."""

from collections.abc import Callable
from typing import Any, Final

from rclpy.node import Node
from std_srvs.srv import Trigger

from ema_interfaces.msg import PlaybackState
from ema_interfaces.srv import SeekPlayback, SetPlaybackRate
from ema_ros.executor import WaitingCallbackGroup
from ema_ros.topics import LATCHED, PLAYBACK_STATE

Act = Callable[[Any], None]
"""Does what a request asks; ValueError or OSError when that is not possible."""

_KINDS: Final = {
    "pause": Trigger,
    "resume": Trigger,
    "set_rate": SetPlaybackRate,
    "seek": SeekPlayback,
}


class Steering:
    """Services ``~/pause``, ``~/resume``, ``~/set_rate``, ``~/seek``, and ``playback_state``.

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
                act(request)
            except (OSError, ValueError) as error:
                response.message = str(error)
            else:
                response.success = True
            return response

        return answer
