"""What a planner reads: why health has its level, and by when to remove the unit."""

import math
from dataclasses import replace

from ema_core.levels import ERROR, OK, STALE, WARN
from ema_monitor.health import FaultHealth, Health
from ema_monitor.prognosis.growth.prediction import RemainingLife
from ema_monitor.prognosis.outlook import Outlook, Removal, unknown_outlook
from ema_monitor.prognosis.sentences import cause_of_level, removal_in_words

MARGIN = FaultHealth("torque_margin", WARN, 0.59, 0.01, 0.5, True, 0.4)
PLAY = FaultHealth("free_play", ERROR, 6e-4, 1e-5, 5e-4, False, 1.2)
FRICTION = FaultHealth("friction", WARN, 0.2, 0.01, 0.5, False, 0.4)


def outlook(level: int, *items: FaultHealth, reason: str = "", **changes: object) -> Outlook:
    health = Health(
        level,
        0.5,
        1,
        1.0,
        "",
        faults=tuple(item for item in items if item.name == "friction"),
        requirements=tuple(item for item in items if item.name != "friction"),
        reason=reason,
    )
    return replace(unknown_outlook(""), health=health, **changes)


def test_cause_names_what_has_the_level_with_value_and_limit():
    assert cause_of_level(outlook(OK)) == ""
    assert cause_of_level(outlook(WARN, MARGIN)) == "torque margin 0.59 (fails below 0.5)"
    failed = outlook(ERROR, MARGIN, PLAY)
    assert cause_of_level(failed) == "free play 0.6 mrad (failed: above 0.5 mrad)"
    stale = outlook(STALE, reason="no telemetry for 3 s")
    assert cause_of_level(stale) == "no telemetry for 3 s"


def test_cause_names_first_what_ends_life_first():
    two = outlook(WARN, FRICTION, MARGIN, dominant="torque_margin")
    assert cause_of_level(two) == (
        "torque margin 0.59 (fails below 0.5), friction 0.2 (fails above 0.5)"
    )


def test_unit_that_failed_is_to_be_removed_even_when_its_health_is_stale():
    lives = {"free_play": RemainingLife.unknown("free play exceeds 0.5 mrad", "")}
    failed = outlook(ERROR, PLAY, lives=lives, hours=170.0, failed_since=150.0)
    words = "Remove now: failed since 150 h (now 170 h): free play exceeds 0.5 mrad"
    assert removal_in_words(failed) == words
    stale = replace(failed, health=replace(failed.health, level=STALE))
    assert removal_in_words(stale) == words
    unknown_since = replace(failed, failed_since=math.nan)
    assert removal_in_words(unknown_since) == "Remove now: failed: free play exceeds 0.5 mrad"


def test_life_that_ends_beyond_the_horizon_has_no_hour_of_its_median():
    life = RemainingLife(True, 20.0, math.inf, math.inf, "friction exceeds 0.5")
    removal = Removal(hours=20.0)
    words = removal_in_words(outlook(OK, rul=life, hours=100.0, removal=removal))
    assert words.startswith("Remove before 120 service hours (in 20 h; 5 % risk")
    assert "median end of life beyond what is looked ahead" in words


def test_a_removal_is_told_in_hours_cycles_and_days_at_the_risk_that_is_accepted():
    life = RemainingLife(True, 20.0, 50.0, 90.0, "friction exceeds 0.5")
    removal = Removal(0.125, 30.0, 15.0, 3.75, 8.0)
    words = removal_in_words(outlook(OK, rul=life, hours=100.0, removal=removal))
    assert words == (
        "Remove before 130 service hours (in 30 h, 15 test cycles, 4 days at 8 h a day; "
        "12.5 % risk of failure until then); median end of life 150 h: friction exceeds 0.5"
    )
    soon = removal._replace(hours=0.4, cycles=0.2, days=math.nan)
    words = removal_in_words(outlook(OK, rul=life, hours=100.0, removal=soon))
    assert words.startswith("Remove now (in 0 h, 0 test cycles; 12.5 % risk")
