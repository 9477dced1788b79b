"""Quality of service in the words of rosbag2."""

from typing import Any

import yaml
from rclpy.duration import Duration
from rclpy.qos import LivelinessPolicy, QoSProfile

_INFINITE_NS = 2**63 - 1


def offered_qos(qos: QoSProfile) -> dict[str, Any]:
    """Return a profile as a mapping in rosbag2's words.

    What a profile leaves open is told as discovery would: infinite durations, automatic
    liveliness.
    """
    liveliness = qos.liveliness
    if liveliness == LivelinessPolicy.SYSTEM_DEFAULT:
        liveliness = LivelinessPolicy.AUTOMATIC
    return {
        "history": qos.history.short_key,
        "depth": qos.depth,
        "reliability": qos.reliability.short_key,
        "durability": qos.durability.short_key,
        "deadline": _seconds(qos.deadline),
        "lifespan": _seconds(qos.lifespan),
        "liveliness": liveliness.short_key,
        "liveliness_lease_duration": _seconds(qos.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": qos.avoid_ros_namespace_conventions,
    }


def offered_qos_profiles(qos: QoSProfile) -> str:
    """Return the text of a channel's ``offered_qos_profiles``: YAML of a list of profiles."""
    return yaml.safe_dump([offered_qos(qos)], sort_keys=False)


def _seconds(duration: Duration) -> dict[str, int]:
    sec, nsec = divmod(duration.nanoseconds or _INFINITE_NS, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}
