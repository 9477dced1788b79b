"""What each of our nodes says, hears, answers and asks: the least that a policy has to permit."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from ema_dashboard.known_topics import CLOCK, DIAGNOSTICS, known_topics
from ema_ros import topics

_OF_ALL: Final = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
    "get_type_description",
)
_OF_LIFECYCLES: Final = (
    "change_state",
    "get_available_states",
    "get_available_transitions",
    "get_state",
    "get_transition_graph",
)
_SAID_BY_ALL: Final = ("/rosout", "/parameter_events")
_STEERED_BY_DASHBOARD: Final = ("pause", "resume", "seek", "set_rate")
_STEERING: Final = (
    *_STEERED_BY_DASHBOARD,
    "burst",
    "get_rate",
    "is_paused",
    "play_next",
    "toggle_paused",
)
_WATCHED: Final = (
    topics.HEALTH,
    topics.FAULT_ESTIMATE,
    topics.PLAYBACK_STATE,
    DIAGNOSTICS,
    CLOCK,
)
_WATCHED_BY_DEMO: Final = (
    topics.HEALTH,
    topics.FAULT_ESTIMATE,
    topics.SIMULATED_FAULTS,
    topics.TELEMETRY,
    DIAGNOSTICS,
)


@dataclass(frozen=True)
class GraphNames:
    """Full names of what a node has in the graph, each list in order.

    Attributes
    ----------
    namespace, name
        Of the node.
    publishes, subscribes
        Topics; ``*`` at the end stands for any rest.
    replies, requests
        Services that it has, and those that it calls.
    executes
        Actions that it has.
    """

    namespace: str
    name: str
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    replies: tuple[str, ...] = ()
    requests: tuple[str, ...] = ()
    executes: tuple[str, ...] = ()

    @property
    def enclave(self) -> str:
        """Path of the enclave that ``ema`` and the launch files give the node."""
        return f"{self.namespace.rstrip('/')}/{self.name}"


def node_access(
    namespace: str = topics.NAMESPACE, bridged: Iterable[str] = ()
) -> Mapping[str, GraphNames]:
    """Return what each node has in the graph, by the name of the node."""
    prefix = namespace.rstrip("/")

    def full(names: Iterable[str]) -> tuple[str, ...]:
        return tuple(name if name.startswith("/") else f"{prefix}/{name}" for name in names)

    everything = f"{prefix}/*"
    shown = [topic.name for topic in known_topics([namespace]) if topic.request is not None]
    heard_by_monitor = (
        topics.TELEMETRY,
        topics.DESCRIPTION,
        topics.USAGE,
        *topics.SYSTEM_TOPICS,
    )
    found = [
        _managed(
            prefix,
            "actuator",
            publishes=(*full(topics.ACTUATOR_TOPICS), CLOCK),
            replies=("set_command", "set_faults"),
        ),
        _managed(
            prefix,
            "bridge",
            publishes=full((topics.TELEMETRY, topics.DESCRIPTION)),
            subscribes=full(bridged),
        ),
        _managed(
            prefix,
            "monitor",
            publishes=full(topics.MONITOR_TOPICS),
            subscribes=full(heard_by_monitor),
            replies=("calibrate", "forget_actuator", "get_history", "predict_remaining_life"),
            executes=("identify_faults",),
        ),
        _managed(prefix, "recorder", subscribes=(everything, DIAGNOSTICS), replies=("snapshot",)),
        # A bag may hold whatever a recorder hears.
        _managed(prefix, "player", publishes=(everything, CLOCK), replies=_STEERING),
        _managed(
            prefix,
            "dashboard",
            subscribes=shown,
            requests=full(
                ("monitor/get_history", *(f"player/{name}" for name in _STEERED_BY_DASHBOARD))
            ),
        ),
        _plain("watch", full(_WATCHED)),
        _plain("demo", full(_WATCHED_BY_DEMO), requests=full(("actuator/set_faults",))),
    ]
    return {item.name: item for item in found}


def _managed(
    prefix: str,
    name: str,
    *,
    publishes: Iterable[str] = (),
    subscribes: Iterable[str] = (),
    replies: Iterable[str] = (),
    requests: Iterable[str] = (),
    executes: Iterable[str] = (),
) -> GraphNames:
    """Return what a lifecycle node has, with what all of them have."""
    own = f"{prefix}/{name}/"
    services = (*_OF_ALL, *_OF_LIFECYCLES, *replies)
    return GraphNames(
        prefix or "/",
        name,
        _sorted(*_SAID_BY_ALL, DIAGNOSTICS, f"{own}transition_event", *publishes),
        _sorted(CLOCK, *subscribes),
        _sorted(*(own + item for item in services)),
        _sorted(*requests),
        _sorted(*(own + item for item in executes)),
    )


def _plain(name: str, subscribes: Iterable[str], requests: Iterable[str] = ()) -> GraphNames:
    """Return what a node of a command has, which publishes nothing, in a namespace of its name."""
    services = _sorted(*(f"/{name}/{name}/{item}" for item in _OF_ALL))
    heard, asked = _sorted(*subscribes), _sorted(*requests)
    return GraphNames(f"/{name}", name, _sorted(*_SAID_BY_ALL), heard, services, asked)


def _sorted(*names: str) -> tuple[str, ...]:
    return tuple(sorted(set(names)))
