# SPDX-License-Identifier: Apache-2.0
"""Quality of service in the format of rosbag2.

The library rosbags writes this format as well, but converting its classes to rclpy would take as
much code.
"""

from collections.abc import Sequence
from typing import Any, Final

import yaml
from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPolicyEnum,
    QoSProfile,
    ReliabilityPolicy,
)

from ema_core.yaml_file import parse_yaml
from ema_ros.topics import ALIVE

RELIABLE_DEPTH: Final = 1000
"""Queue depth of recorders and players, for slow writers or readers [messages]."""

_UNKNOWN_DEPTH = 10  # as in rosbag2: discovery does not report the depth of a publisher
_INFINITE_NS = 2**63 - 1


def offered_qos(qos: QoSProfile) -> dict[str, Any]:
    """Return a profile as a mapping in the format of rosbag2.

    Unspecified values are written as discovery reports them: infinite durations and automatic
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
    """Return the ``offered_qos_profiles`` of a channel: a list of profiles in YAML."""
    return yaml.safe_dump([offered_qos(qos)], sort_keys=False)


def recorded_qos(text: str) -> list[QoSProfile]:
    """Return the profiles in the ``offered_qos_profiles`` of a channel.

    Parameters
    ----------
    text
        A list of profiles in YAML, with policies as names, or as numbers before Jazzy; may be
        empty.

    Raises
    ------
    ValueError
        If the text is not a list of profiles.
    """
    try:
        return [_profile(item) for item in parse_yaml(text.encode()) or ()]
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(
            f"offered_qos_profiles {text[:60]!r}...: expected a list of profiles ({error!r})"
        ) from error


def common_offer(offers: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Return the strongest profile that all publishers of a topic offer.

    ``offers`` must not be empty.
    """
    is_reliable = all(item.reliability == ReliabilityPolicy.RELIABLE for item in offers)
    is_latched = all(item.durability == DurabilityPolicy.TRANSIENT_LOCAL for item in offers)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if is_latched else DurabilityPolicy.VOLATILE,
    )


def joint_offer(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return the profile to record for a topic: the offer if all are equal, else a common offer."""
    if all(item == offers[0] for item in offers):
        return offers[0]
    return common_offer(offers, _UNKNOWN_DEPTH)


def replay_qos(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return the quality of service with which a player replaces the recorded publishers.

    A latched topic keeps its depth, so that a late subscription receives what it would have
    received. Any other reliable topic gets a depth of at least ``RELIABLE_DEPTH``, so that playing
    fast loses nothing. A player asserts its liveliness with the recorded lease, at most
    ``LEASE_S``, even if none is recorded: its publishers replace publishers that were alive.

    Parameters
    ----------
    offers
        Profiles of the recorded publishers; empty for a reliable stream.
    """
    if not offers:
        offers = [QoSProfile(depth=RELIABLE_DEPTH)]
    joint = joint_offer(offers)
    depth = joint.depth if joint.history == HistoryPolicy.KEEP_LAST else 0
    profile = common_offer(offers, depth or _UNKNOWN_DEPTH)
    if (profile.reliability, profile.durability) == (
        ReliabilityPolicy.RELIABLE,
        DurabilityPolicy.VOLATILE,
    ):
        profile.depth = max(profile.depth, RELIABLE_DEPTH)
    profile.deadline, profile.lifespan = joint.deadline, joint.lifespan
    profile.liveliness = LivelinessPolicy.AUTOMATIC
    recorded_ns = joint.liveliness_lease_duration.nanoseconds or _INFINITE_NS
    lease_ns = min(recorded_ns, ALIVE.liveliness_lease_duration.nanoseconds)
    profile.liveliness_lease_duration = Duration(nanoseconds=lease_ns)
    return profile


def _profile(entries: dict[str, Any]) -> QoSProfile:
    return QoSProfile(
        history=_policy(HistoryPolicy, entries["history"]),
        depth=int(entries["depth"]),
        reliability=_policy(ReliabilityPolicy, entries["reliability"]),
        durability=_policy(DurabilityPolicy, entries["durability"]),
        deadline=_duration(entries["deadline"]),
        lifespan=_duration(entries["lifespan"]),
        liveliness=_policy(LivelinessPolicy, entries["liveliness"]),
        liveliness_lease_duration=_duration(entries["liveliness_lease_duration"]),
        avoid_ros_namespace_conventions=bool(entries["avoid_ros_namespace_conventions"]),
    )


def _policy(kind: type[QoSPolicyEnum], value: str | int) -> QoSPolicyEnum:
    return kind(value if isinstance(value, int) else kind.get_from_short_key(value))


def _duration(parts: dict[str, int]) -> Duration:
    return Duration(nanoseconds=min(parts["sec"] * 1_000_000_000 + parts["nsec"], _INFINITE_NS))


def _seconds(duration: Duration) -> dict[str, int]:
    sec, nsec = divmod(duration.nanoseconds or _INFINITE_NS, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}
