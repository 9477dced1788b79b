"""Random walks through the lifecycle of nodes, the window queue, and the prognosis of a unit."""

from collections.abc import Mapping
from typing import Final

from part import Case, Goal, Part
from stateful import judged, unreached, walk
from walk_lifecycle import Lifecycle
from walk_prognosis import Prognosis
from walk_queue import Queue

_MACHINES: Final = (Queue, Lifecycle, Prognosis)
_WALKS: Final = {"queue": (400, 50), "lifecycle": (60, 30), "prognosis": (40, 25)}

STEPS: Final = 100_000
"""Steps that are asked of a campaign."""


def run(case: Case) -> None:
    """Walk through the machine whose turn it is."""
    kind = _MACHINES[case.number % len(_MACHINES)]
    walks, steps = _WALKS[kind.machine()]
    walk(case, kind, min(case.steps or walks, walks), steps)


def judge(counts: Mapping[str, int]) -> list[str]:
    """Every state is reached."""
    return [words for kind in _MACHINES for words in unreached(counts, kind)]


def goals(counts: Mapping[str, int]) -> list[Goal]:
    """Steps of all walks, and walks of each machine."""
    steps = sum(counts.get(f"{kind.machine()}: steps", 0) for kind in _MACHINES)
    return [Goal("steps", STEPS, steps), *(judged(counts, kind) for kind in _MACHINES)]


PART: Final = Part(
    name="state_machines",
    summary="what holds does so in all orders of steps; every state is reached",
    run=run,
    usual_s=90.0,
    limit_s=1800.0,
    share=0.6,
    judge=judge,
    goals=goals,
)
