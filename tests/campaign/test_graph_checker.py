"""The checker of recorded graphs finds each violation of its rules, and nothing else."""

import importlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest

CAMPAIGN = Path(__file__).parents[2] / "campaign"
START_NS = 1_700_000_000_000_000_000
S = 1_000_000_000
PERIOD_S = 2
CYCLES = 30


class Modules(NamedTuple):
    record: ModuleType
    checker: ModuleType


@pytest.fixture(scope="module")
def modules() -> Modules:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(CAMPAIGN))
        return Modules(
            importlib.import_module("graph_record"), importlib.import_module("graph_checker")
        )


@pytest.fixture
def record(modules: Modules) -> Any:
    """A minute of an actuator that is tested every 2 s; the fourth window is refused."""
    made = modules.record.GraphRecord(start_ns=START_NS, end_ns=START_NS + CYCLES * PERIOD_S * S)
    for number in range(CYCLES * PERIOD_S * 100):
        stamp_ns = START_NS + number * S // 100
        made.blocks.append(
            modules.record.Block("flap", stamp_ns, 1e-4, 100 * number, 100, stamp_ns + S // 100)
        )
    valid = invalid = 0
    for number in range(CYCLES):
        end_ns = START_NS + (number * PERIOD_S + 1) * S
        sent_ns, refused = end_ns + S // 10, number == 4
        made.found.append(modules.record.FoundWindow("flap", end_ns - S // 2, end_ns, end_ns))
        made.answers.append(
            modules.record.Answer(
                "flap", "SN", number, end_ns - S // 2, end_ns, end_ns,
                not refused, refused, True, "it is refused" if refused else "", sent_ns,
            )
        )  # fmt: skip
        if not refused:
            made.healths.append(
                modules.record.HealthNote("flap", "SN", end_ns, 0, sent_ns + S // 100)
            )
        valid, invalid = valid + (not refused), invalid + refused
        for half in range(2):
            at_ns = sent_ns + S // 50 + half * S
            counts = {
                "blocks": (at_ns - START_NS) * 100 // S - 5,
                "samples lost": 0,
                "windows": number + 1,
                "estimates valid": valid,
                "estimates invalid": invalid,
            }
            values = {key: str(value) for key, value in counts.items()}
            made.statuses.append(
                modules.record.StatusNote("/ema/monitor: flap telemetry", 0, "", values, at_ns)
            )
            recorded = {"messages": str(10 * number), "lost messages": "0"}
            made.statuses.append(
                modules.record.StatusNote("/ema/recorder: recording", 0, "", recorded, at_ns)
            )
    made.messages = 10 * CYCLES
    return made


def rules(modules: Modules, record: Any) -> set[str]:
    return {violation.rule for violation in modules.checker.check(record).violations}


def test_faithful_graph_keeps_all_rules(modules: Modules, record: Any):
    findings = modules.checker.check(record)
    assert findings.violations == []
    assert (findings.counts["windows"], findings.counts["valid"]) == (CYCLES, CYCLES - 1)
    assert findings.counts["runs"] == 1


def twice_by_number(record: Any) -> None:
    record.answers.insert(8, replace(record.answers[7], sent_ns=record.answers[7].sent_ns + 1))


def twice_by_window(record: Any) -> None:
    early = record.answers[7]
    record.answers[8] = replace(
        record.answers[8], start_ns=early.start_ns, end_ns=early.end_ns, stamp_ns=early.end_ns
    )


def without_answer(record: Any) -> None:
    del record.answers[7]


def counted_only(record: Any) -> None:
    """The monitor counts windows that nobody hears of again."""
    for place, status in enumerate(record.statuses[20:], 20):
        if "windows" in status.values:
            windows = str(int(status.values["windows"]) + CYCLES)
            record.statuses[place] = replace(status, values={**status.values, "windows": windows})


def never_seen(record: Any) -> None:
    """A window is in the telemetry that the monitor neither counted nor answered."""
    early = record.found[6]
    record.found.insert(
        7,
        replace(
            early, start_ns=early.start_ns + S, end_ns=early.end_ns + S, sent_ns=early.sent_ns + S
        ),
    )


def health_of_refused(record: Any) -> None:
    refused = record.answers[4]
    after = replace(record.healths[3], stamp_ns=refused.end_ns, sent_ns=refused.sent_ns + 1)
    record.healths.insert(4, after)


def health_of_nothing(record: Any) -> None:
    record.healths[6] = replace(record.healths[6], stamp_ns=record.healths[6].stamp_ns + S // 5)


def health_before_estimate(record: Any) -> None:
    record.healths[6] = replace(record.healths[6], sent_ns=record.answers[7].sent_ns - S // 20)


def answers_swapped(record: Any) -> None:
    early, late = record.answers[7], record.answers[8]
    record.answers[7:9] = [
        replace(late, sent_ns=early.sent_ns),
        replace(early, sent_ns=late.sent_ns),
    ]


def health_goes_back(record: Any) -> None:
    late = record.healths[9]
    again = replace(record.healths[6], sent_ns=late.sent_ns + 1)
    record.healths.insert(10, again)


def stamp_beside_end(record: Any) -> None:
    record.answers[7] = replace(record.answers[7], stamp_ns=record.answers[7].start_ns)


def answer_before_end(record: Any) -> None:
    record.answers[7] = replace(record.answers[7], sent_ns=record.answers[7].end_ns - S // 10)


def verdict_contradicts(record: Any) -> None:
    record.answers[7] = replace(record.answers[7], refused=True)


def refused_without_reason(record: Any) -> None:
    record.answers[4] = replace(record.answers[4], reason="")


def valid_without_numbers(record: Any) -> None:
    record.answers[7] = replace(record.answers[7], is_finite=False)


def block_early(record: Any) -> None:
    record.blocks[500] = replace(
        record.blocks[500], stamp_ns=record.blocks[500].stamp_ns - S // 200
    )


def estimates_not_counted(record: Any) -> None:
    for place, status in enumerate(record.statuses[20:], 20):
        if "windows" in status.values:
            values = {
                **status.values,
                "estimates valid": str(int(status.values["estimates valid"]) + 3),
            }
            record.statuses[place] = replace(status, values=values)


def dropped_without_word(record: Any) -> None:
    status = record.statuses[-2]
    record.statuses[-2] = replace(status, values={**status.values, "windows dropped": "5"})


def block_lost_silently(record: Any) -> None:
    del record.blocks[500]


def heard_more_than_sent(record: Any) -> None:
    status = record.statuses[-2]
    record.statuses[-2] = replace(status, values={**status.values, "blocks": "90000"})


def bag_has_less(record: Any) -> None:
    record.messages = 7


@pytest.mark.parametrize(
    ("plant", "rule"),
    [
        (twice_by_number, "identified twice"),
        (twice_by_window, "identified twice"),
        (without_answer, "unanswered"),
        (counted_only, "unanswered"),
        (never_seen, "unanswered"),
        (health_of_refused, "health of a refused test"),
        (health_of_nothing, "health of a refused test"),
        (health_before_estimate, "health of a refused test"),
        (answers_swapped, "order"),
        (health_goes_back, "order"),
        (stamp_beside_end, "stamps"),
        (answer_before_end, "stamps"),
        (verdict_contradicts, "stamps"),
        (refused_without_reason, "stamps"),
        (valid_without_numbers, "stamps"),
        (block_early, "stamps"),
        (estimates_not_counted, "counters"),
        (dropped_without_word, "counters"),
        (block_lost_silently, "counters"),
        (heard_more_than_sent, "counters"),
        (bag_has_less, "counters"),
    ],
)
def test_planted_violation_is_found(
    modules: Modules, record: Any, plant: Callable[[Any], None], rule: str
):
    plant(record)
    assert rule in rules(modules, record)


def test_windows_dropped_before_a_record_may_be_answered_in_it(modules: Modules, record: Any):
    """A window is counted as dropped at once; its refusal waits behind the windows before it."""
    dropped = range(5, 8)
    for number in dropped:
        record.answers[number] = replace(
            record.answers[number], valid=False, refused=True, reason="dropped: too many waited"
        )
    ends = {record.answers[number].end_ns for number in dropped}
    record.healths = [item for item in record.healths if item.stamp_ns not in ends]
    for place, status in enumerate(record.statuses):
        if "windows" not in status.values:
            continue
        answered = sum(item.sent_ns < status.sent_ns for item in record.answers)
        invalid = sum(item.sent_ns < status.sent_ns and not item.valid for item in record.answers)
        counts = {
            "windows": max(answered, dropped.stop),
            "windows dropped": len(dropped),
            "estimates valid": answered - invalid,
            "estimates invalid": invalid,
        }
        values = {**status.values, **{key: str(value) for key, value in counts.items()}}
        record.statuses[place] = replace(status, values=values)
    assert rules(modules, record) == set()


def test_what_the_recorder_counts_as_lost_is_no_violation(modules: Modules, record: Any):
    without_answer(record)
    del record.healths[6]
    block_lost_silently(record)
    status = record.statuses[-1]
    record.statuses[-1] = replace(status, values={**status.values, "lost messages": "3"})
    assert rules(modules, record) == set()


def test_what_came_while_the_recorder_stood_still_is_no_violation(modules: Modules, record: Any):
    early = record.answers[6].sent_ns
    del record.answers[6:8]
    assert "unanswered" in rules(modules, record)
    # It stood still at another time: after a standstill it may take a while to be found again.
    for start_s, end_s in ((-30, -20), (25, 35)):
        record.standstills = [(early + start_s * S, early + end_s * S)]
        assert "unanswered" in rules(modules, record)
    record.standstills = [(early - S, early + 3 * S)]
    assert rules(modules, record) == set()


def test_standstill_excuses_no_count_at_another_time(modules: Modules, record: Any):
    counted_only(record)
    assert "unanswered" in rules(modules, record)
    record.standstills = [(record.start_ns - 9 * S, record.start_ns - 6 * S)]
    assert "unanswered" in rules(modules, record)


def tell_lost(record: Any, by_topic: str) -> None:
    status = record.statuses[-1]
    values = {**status.values, "lost messages": "900", "lost by topic": by_topic}
    record.statuses[-1] = replace(status, values=values)


@pytest.mark.parametrize(
    ("plant", "rule", "lost"),
    [
        (without_answer, "unanswered", "fault_estimate"),
        (counted_only, "unanswered", "fault_estimate"),
        (never_seen, "unanswered", "fault_estimate"),
        (health_of_nothing, "health of a refused test", "fault_estimate"),
        (estimates_not_counted, "counters", "fault_estimate"),
        (dropped_without_word, "counters", "fault_estimate"),
        (block_lost_silently, "counters", "telemetry"),
    ],
)
def test_loss_on_one_topic_excuses_no_other(
    modules: Modules, record: Any, plant: Callable[[Any], None], rule: str, lost: str
):
    plant(record)
    (other,) = {"fault_estimate", "telemetry"} - {lost}
    tell_lost(record, f"/ema/{other} 900, /ema/health 900")
    assert rule in rules(modules, record)
    tell_lost(record, f"/ema/{lost} 900, /ema/health 900")
    assert rule not in rules(modules, record)


def test_what_came_before_the_recorder_found_the_answers_is_no_violation(
    modules: Modules, record: Any
):
    del record.answers[:2], record.healths[:2]
    assert rules(modules, record) == set()
    del record.answers[:6], record.healths[:5]
    assert "unanswered" in rules(modules, record)


def test_status_that_comes_late_begins_no_run_and_a_restart_soon_after_the_start_does(
    modules: Modules, record: Any
):
    own = [place for place, one in enumerate(record.statuses) if "windows" in one.values]
    early, late = (record.statuses[own[at]] for at in (20, 21))
    fewer = {**late.values, "blocks": str(int(late.values["blocks"]) - 3)}
    again = replace(late, values=fewer, sent_ns=late.sent_ns + S // 10)
    record.statuses.insert(own[21] + 1, again)
    assert modules.checker.check(record).counts["runs"] == 1
    values = {**late.values, "blocks": "90", "windows": "0", "estimates valid": "0"}
    few = {**values, "blocks": "95"}
    record.statuses = [
        replace(early, values=few),
        replace(late, values=values, sent_ns=early.sent_ns + 3 * S),
    ]
    assert modules.checker.check(record).counts["runs"] == 2


def test_graph_without_status_is_checked_by_its_answers_alone(modules: Modules, record: Any):
    record.statuses = []
    assert rules(modules, record) == set()
    twice_by_number(record)
    assert rules(modules, record) == {"identified twice"}


def test_jump_of_a_replay_that_is_told_is_no_loss(modules: Modules, record: Any):
    del record.blocks[5701:5750]
    assert rules(modules, record) == {"counters"}
    record.jumps_ns = [record.blocks[5700].sent_ns + 1]
    assert rules(modules, record) == set()


def test_restarted_monitor_begins_its_numbers_anew(modules: Modules, record: Any):
    half = CYCLES // 2
    boundary_ns = record.answers[half].sent_ns - S // 4
    for place, answer in enumerate(record.answers[half:], half):
        record.answers[place] = replace(answer, window=place - half)
    first = next(
        one for one in record.statuses if one.sent_ns > boundary_ns and "windows" in one.values
    )
    before = {key: int(value) for key, value in first.values.items()}
    for place, status in enumerate(record.statuses):
        if status.sent_ns > boundary_ns and "windows" in status.values:
            values = {key: str(int(text) - before[key]) for key, text in status.values.items()}
            values |= {
                "windows": str(int(values["windows"]) + 1),
                "estimates valid": str(int(values["estimates valid"]) + 1),
            }
            record.statuses[place] = replace(status, values=values)
    findings = modules.checker.check(record)
    assert findings.violations == []
    assert findings.counts["runs"] == 2
