"""What a report says first: is the unit well, what wears, how long it lasts, what to do."""

import math
from dataclasses import dataclass
from typing import Final

from ema_cli.bags.unit_course import Course
from ema_cli.report.evidence import life_in_words, moment, shown
from ema_cli.show.advice import advice_in_words
from ema_core.causes import CAUSE_BY_NAME, Place
from ema_core.faults import FAULT_BY_NAME, FAULTS
from ema_core.levels import ERROR, LEVEL_NAMES, OK, STALE, WARN
from ema_core.wording import counted
from ema_monitor.health import FaultHealth
from ema_monitor.identification.estimate import FAILED, Estimate
from ema_monitor.prognosis.outlook import Outlook
from ema_monitor.prognosis.sentences import TREND_HOURS, cause_of_level, removal_in_words

_STATES: Final = {OK: "Well", WARN: "Wearing", ERROR: "Failed", STALE: "Unknown"}


@dataclass(frozen=True)
class UnitVerdict:
    """The verdict in three lines, and what to do.

    Attributes
    ----------
    level
        Level of health.
    lines
        Whether the unit is well; what wears; how long it lasts.
    actions
        What to do, the most important first.
    """

    level: int
    lines: tuple[str, str, str]
    actions: list[str]

    @property
    def level_name(self) -> str:
        """Name of the level."""
        return LEVEL_NAMES[self.level]


def verdict_of(course: Course) -> UnitVerdict:
    """Return the verdict on a unit."""
    last = course.now
    if not course.outlooks:
        tests = counted(len(course.estimates), "test")
        why = f"{cause_of_level(last)}; " if last.failure else ""
        return UnitVerdict(
            last.health.level,
            (
                f"{_STATES[last.health.level]}: {why}none of {tests} has a valid estimate.",
                "What wears is unknown.",
                "How long it lasts is unknown.",
            ),
            _after_the_last_test(course),
        )
    valid = [one for one in course.estimates if one.valid][-1]
    lines = _state(course, last), _wearing(course, last, valid), _lasting(last)
    words = [advice_in_words(course), removal_in_words(last)]
    actions = [*map(_sentence, filter(None, words)), *_after_the_last_test(course)]
    return UnitVerdict(last.health.level, lines, actions)


def _state(course: Course, last: Outlook) -> str:
    health = last.health
    why = (
        cause_of_level(last)
        if health.level != OK
        else ("no fault and no required performance gives a warning")
    )
    tests = f"{counted(len(course.outlooks), 'valid test')} of {len(course.estimates)}"
    index = f"{health.health_index:.2f}" if math.isfinite(health.health_index) else "unknown"
    return (
        f"{_STATES[health.level]}: {why} ({tests}; health index {index}, severity "
        f"{health.severity} of 4, confidence {health.confidence:.2f})."
    )


def _wearing(course: Course, last: Outlook, valid: Estimate) -> str:
    items = {item.name: item for item in (*last.health.faults, *last.health.requirements)}
    found = {fault.name for fault, is_found in zip(FAULTS, valid.found, strict=True) if is_found}
    worn = [item for item in last.health.faults if item.name in found]
    worst = max(worn, key=lambda item: item.share, default=None)
    named = [items[last.dominant]] if last.dominant in items else []
    if worst is not None and worst not in named:
        named.append(worst)
    if not named:
        return "Nothing wears: no fault differs from healthy by more than its uncertainty."
    parts = [_item_in_words(item, last) for item in named]
    return f"{_sentence('; behind it '.join(parts))}"


def _item_in_words(item: FaultHealth, last: Outlook) -> str:
    what = shown(item)
    words = f"{what.label} {what.value_and_sigma} against its limit {what.limit}"
    fault = FAULT_BY_NAME.get(item.name)
    notes = [fault.physical(item.value)] if fault is not None else []
    if math.isfinite(item.share):
        notes.append(f"{100.0 * item.share:.0f} % of the way")
    trend = what.scale * TREND_HOURS * last.trends.get(item.name, math.nan)
    if math.isfinite(trend):
        notes.append(f"{trend:+.3g}{what.unit} in {TREND_HOURS:g} h")
    return f"{words} ({', '.join(notes)})" if notes else words


def _lasting(last: Outlook) -> str:
    life = last.rul
    if last.failure:
        return "Its life is over until it is repaired: drive or shaft has failed."
    if last.health.level == ERROR:
        return "Its life is over: a limit is exceeded or a required performance has failed."
    if not life.known:
        return "How long it lasts is unknown."
    before = last.hours + last.removal.hours
    return (
        f"Remaining useful life {life_in_words(life)} flight hours (5 / 50 / 95 %), until "
        f"{life.criterion}; remove before {before:,.0f} service hours."
    )


def _after_the_last_test(course: Course) -> list[str]:
    """Return what the last test asks for: to be repeated, or to look at what is no fault."""
    last = course.estimates[-1] if course.estimates else None
    if last is None:
        return ["Repeat the test: the motion shows no fault as well as wanted."]
    if last.verdict == FAILED:
        return []
    if not last.valid:
        return [f"Repeat the test of {moment(last.end_ns)}: it was refused, {last.reason}."]
    actions = []
    for cause in last.causes:
        about = CAUSE_BY_NAME[cause.name]
        part = "sensor" if about.place is Place.SENSOR else "installation"
        actions.append(f"Check the {part}: {cause} explains part of the last test and is no fault.")
    for one, other in last.alternatives:
        actions.append(f"The last test cannot separate {one} from {other}: check both.")
    if last.verdict == "degraded" and not last.alternatives:
        actions.append(f"The last test is usable with wider uncertainty: {last.reason}.")
    return actions


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:]}."
