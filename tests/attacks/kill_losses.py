# SPDX-License-Identifier: Apache-2.0
"""Checks of the data that killed nodes lose: the open chunk of a bag, the last test of a history.

Nothing else may be lost.
"""

from pathlib import Path
from typing import Final

from ema_bags.bag_recorder import RecorderSettings
from ema_bags.reader import Bag
from ema_monitor.prognosis.history import History

from ..ros.graph import Graph
from .case import Case
from .graph_checker import check
from .graph_record import read_graph

LATE_S: Final = 0.5
"""Largest loss of a killed recorder in addition to ``flush_s`` [s].

Messages on the way to the recorder are also lost, and its threads may wait for a busy processor.
"""

MOST_LOST_S: Final = RecorderSettings().flush_s + LATE_S

TELEMETRY: Final = "/ema/telemetry"


def measure_loss(case: Case, path: Path, graph: Graph, killed_s: float, *, is_due: bool) -> None:
    """Compare the telemetry sent until a kill with the bag; ``is_due`` if it must have some."""
    recorded: set[int] = set()
    try:
        bag = Bag(path)
        if TELEMETRY in bag.topics:
            recorded = {item.publish_time_ns for item in bag.raw_messages([TELEMETRY])}
    except (FileNotFoundError, ValueError):
        pass  # check_bag reports it
    if not recorded:
        if is_due:
            case.fail(f"{path.name} has no telemetry, although it was recorded")
        return
    first, last = min(recorded), max(recorded)
    sent = [block for block in graph.blocks if first <= block[0] and block[1] <= killed_s]
    lost = [block for block in sent if block[0] not in recorded]
    holes = [block for block in lost if block[0] < last]
    if holes:
        case.fail(f"{path.name}: {len(holes)} blocks are missing before the last one")
    tail_s = min((came_s for sent_ns, came_s in lost if sent_ns > last), default=killed_s)
    case.require(
        killed_s - tail_s <= MOST_LOST_S,
        f"{path.name} lost the last {killed_s - tail_s:.2f} s before the recorder was killed, "
        f"expected {MOST_LOST_S:g} s at most",
    )


def check_bag(case: Case, path: Path, *, is_closed: bool, is_due: bool = True) -> None:
    """Check that a bag can be read. It may be missing or empty unless ``is_due``."""
    try:
        bag = Bag(path)
        count = sum(1 for _ in bag.messages())
        if is_closed and bag.damage:
            case.fail(f"{path.name} was closed and is damaged: {bag.damage}")
        case.count("messages read back", count)
        check(case, read_graph(path), f"{path.name}: ")
    except (FileNotFoundError, ValueError) as error:
        # Otherwise the recorder was killed before it wrote anything.
        if is_due or not (isinstance(error, FileNotFoundError) or "empty" in str(error)):
            case.fail(f"{path.name} cannot be read: {error}")


def check_history(
    case: Case, path: Path, unit: tuple[str, str], answered: list[int], already_missing: set[int]
) -> set[int]:
    """Compare the tests answered until a kill with the history.

    ``known`` are tests that are already known to be missing.

    Returns
    -------
        Stamps of the tests that are missing in the history [ns].
    """
    if not path.exists():
        if len(answered) > 1:
            case.fail(f"no history after {len(answered)} tests")
        return set()
    history = History(*unit, path)
    try:
        kept = {entry.stamp_ns for entry in history.entries}
        problem = history.problem
    finally:
        history.close()
    missing = [stamp for stamp in answered if stamp not in kept | already_missing]
    if problem:
        case.fail(f"the history of a killed monitor: {problem}")
    if missing and (len(missing) > 1 or missing != answered[-1:]):
        case.fail(
            f"{len(missing)} of {len(answered)} tests that were answered are not in the "
            f"history, expected the last one at most"
        )
    return {*missing}
