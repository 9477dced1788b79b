"""Kills at random moments: of the nodes of a graph, and of an archive at work."""

from collections.abc import Mapping
from typing import Final

import killed_archive
import killed_nodes
from part import Case, Goal, Part

KILLS: Final = 500
"""Kills that are asked of a campaign."""

_KILLS_OF_A_CASE: Final = killed_nodes.LIVE_KILLS + killed_nodes.PLAYER_KILLS + killed_archive.KILLS


def run(case: Case) -> None:
    """Do a case: kills of live nodes, one standstill, kills of the player and of an archive."""
    killed_nodes.NodeKills(case).run()
    killed_archive.run(case)


def goals(counts: Mapping[str, int]) -> list[Goal]:
    """Kills of all processes."""
    victims = (*killed_nodes.VICTIMS, *killed_archive.VICTIMS)
    done = sum(counts.get(f"kills of {name}", 0) for name in victims)
    return [Goal("kills", KILLS, done)]


PART: Final = Part(
    "kills",
    "a killed node loses the open chunk or the current test alone, an archive nothing; all go on",
    run,
    usual_s=150.0,
    limit_s=900.0,
    share=3.0,
    most_cases=-(-KILLS // _KILLS_OF_A_CASE),
    goals=goals,
)
