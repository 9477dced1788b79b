"""Changes of level in what is recorded: of the health of actuators, and of diagnostics."""

from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message

from ema_core.levels import LEVEL_NAMES
from ema_interfaces.msg import Health, HealthSummary

_KINDS: Final = (Health, HealthSummary, DiagnosticArray)


class LevelChanges:
    """Finds changes of level in serialised messages.

    Parameters
    ----------
    own
        Full name of the node whose own statuses do not count.
    """

    def __init__(self, own: str) -> None:
        self._own = f"{own}:"
        self._levels: dict[str, int] = {}

    def find(self, message_class: Any, data: bytes) -> str:
        """Return what changed in a message, in words; empty when nothing did.

        The first level of an actuator or status is no change.
        """
        if not issubclass(message_class, _KINDS):
            return ""
        try:
            message: Any = deserialize_message(data, message_class)
        except Exception:  # whatever the middleware makes of what is no message
            return ""
        if message_class is DiagnosticArray:
            levels = {item.name: ord(item.level) for item in message.status}
        else:
            # Both topics tell of the same level.
            levels = {f"health of {message.actuator_id}": message.level}
        changes = []
        for name, level in levels.items():
            before = self._levels.setdefault(name, level)
            if level != before and not name.startswith(self._own):
                changes.append(f"{name} from {_word(before)} to {_word(level)}")
            self._levels[name] = level
        return ", ".join(changes)


def _word(level: int) -> str:
    return LEVEL_NAMES[level] if level < len(LEVEL_NAMES) else str(level)
