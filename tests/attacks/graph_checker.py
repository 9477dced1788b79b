# SPDX-License-Identifier: Apache-2.0
"""Rules for the messages of a graph, which must hold under all disturbances of nodes and links.

The rules are checked on recorded messages and need no ROS. Messages sent while the recorder was
disconnected are missing in a record. They are excused only by the counts in the statuses of
recorder and monitor, and by the times in which the recorder reported a standstill. Any other loss
is a violation, because it was not reported.
"""

import statistics
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, NamedTuple

from .case import Case
from .graph_record import Answer, Block, FoundWindow, GraphRecord, HealthNote, StatusNote

ANSWER_S: Final = 15.0
"""Longest time from a window's last sample to its answer, also under load [s]."""

LEASE_S: Final = 5.0
"""Time after which a silent node counts as gone, as in ``tools/fastdds.xml`` [s]."""

DISCOVERY_S: Final = 10.0
"""Time within which a recorder discovers all topics [s]."""

_STATUS_S: Final = 2.5
_NS: Final = 1_000_000_000
_COUNTS: Final = ("blocks", "windows", "estimates valid")
_MOST_LATE: Final = 50
_LATE_NS: Final = _NS
_AHEAD_NS: Final = 20_000_000
_STAMP_NS: Final = 1_000


class Lost(NamedTuple):
    """Numbers of messages that recorders reported as lost, by topic that the rules need."""

    telemetry: int
    estimates: int


@dataclass
class Run:
    """Messages of a monitor about an actuator between two starts of its node."""

    statuses: list[StatusNote] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)

    @property
    def first_ns(self) -> int:
        """Time at which the first status was sent [ns]."""
        return self.statuses[0].sent_ns

    @property
    def last_ns(self) -> int:
        """Time at which the last status was sent [ns]."""
        return self.statuses[-1].sent_ns

    @property
    def recorded_from_ns(self) -> int:
        """Time from which answers are recorded [ns]; a recorder discovers topics one by one."""
        latest_ns = self.first_ns + round(DISCOVERY_S * _NS)
        return min([latest_ns, *(item.sent_ns for item in self.answers)])

    def counted(self) -> list[StatusNote]:
        """Return the statuses from the time on from which answers are recorded."""
        recorded_from_ns = self.recorded_from_ns if self.statuses else 0
        return [item for item in self.statuses if item.sent_ns >= recorded_from_ns]

    def around(self, start_ns: int, end_ns: int) -> tuple[StatusNote, StatusNote] | None:
        """Return the last status before ``start_ns`` and the first after ``end_ns``, or None."""
        before = [status for status in self.statuses if status.sent_ns <= start_ns]
        after = [status for status in self.statuses if status.sent_ns >= end_ns]
        return (before[-1], after[0]) if before and after else None


def check(case: Case, record: GraphRecord, what: str = "") -> None:
    """Check the rules on a record. Add violations, and counts of windows and runs, to a case."""
    lost = Lost(lost_messages(record, "telemetry"), lost_messages(record, "fault_estimate"))
    for name in record.actuators():
        actuator = _Actuator(record, name)
        for rule, check_rule in _RULES.items():
            for text in check_rule(actuator, lost):
                case.fail(f"{what}{rule}: {name}: {text}")
        case.count("windows", len(actuator.answers))
        case.count("runs", len(actuator.runs))


def lost_messages(record: GraphRecord, topic: str = "") -> int:
    """Return the number of messages that recorders reported as lost, on a topic or on all."""
    latest = {
        status.name: status for status in record.statuses if status.name.endswith(": recording")
    }
    return sum(_lost_on(status, topic) for status in latest.values())


def _lost_on(status: StatusNote, topic: str) -> int:
    reported = status.values.get("lost by topic")
    if not topic or reported is None:
        return status.count("lost messages")
    lost = (item.rpartition(" ") for item in reported.split(", ") if item)
    return sum(int(count) for name, _, count in lost if name.endswith(f"/{topic}"))


class _Actuator:
    """Messages of a record that concern one actuator."""

    def __init__(self, record: GraphRecord, name: str) -> None:
        self.name = name
        self.is_simulated = bool(record.clock_ns)
        self.end_ns = record.end_ns
        self.player_jumps_ns = record.jumps_ns
        self._standstills = record.standstills
        self.blocks = [item for item in record.blocks if item.actuator_id == name]
        self.answers = [item for item in record.answers if item.actuator_id == name]
        self.healths = [item for item in record.healths if item.actuator_id == name]
        self.found = [item for item in record.found if item.actuator_id == name]
        suffix = f": {name} telemetry"
        self.runs = _runs([item for item in record.statuses if item.name.endswith(suffix)])
        _deal(self.answers, self.runs)
        self.jumps_ns = [
            late.sent_ns
            for early, late in zip(self.blocks, self.blocks[1:], strict=False)
            if late.stamp_ns <= early.stamp_ns
        ]

    def missed_ns(self, start_ns: int, end_ns: int) -> list[int]:
        """Return the durations without reception between two times, one per standstill [ns].

        After a standstill longer than the lease of DDS, the recorder has to be discovered again.
        """
        spans = []
        for first, last in self._standstills:
            rediscovered_ns = last + (
                round(DISCOVERY_S * _NS) if last - first > LEASE_S * _NS else 0
            )
            if (span := min(end_ns, rediscovered_ns) - max(start_ns, first)) >= 0:
                spans.append(span)
        return spans

    def possibly_missed(self, start_ns: int, end_ns: int) -> int:
        """Return the number of answers that may have been sent while nothing was received."""
        steps = [late.sent_ns - early.sent_ns for early, late in pairwise(self.answers)]
        period_ns = max(statistics.median(steps or [_NS]), _NS / 10)
        return sum(1 + int(span / period_ns) for span in self.missed_ns(start_ns, end_ns))

    def times_sent(self, time_ns: int) -> int:
        """Return the number of blocks that contain a time."""
        return sum(
            block.stamp_ns - _STAMP_NS <= time_ns <= _end_ns(block) + _STAMP_NS
            for block in self.blocks
        )

    def goes_back_between(self, early_ns: int, late_ns: int) -> bool:
        """Return whether telemetry went back in time between two times, or shortly before."""
        margin = round(ANSWER_S * _NS)
        return any(early_ns - margin <= at_ns <= late_ns for at_ns in self.jumps_ns)


def _runs(statuses: list[StatusNote]) -> list[Run]:
    """Return the runs of a monitor. A new run begins where its counts restart."""
    runs: list[Run] = []
    for status in statuses:
        if "blocks" not in status.values:
            continue
        if not runs or _is_new_run(runs[-1].statuses[-1], status):
            runs.append(Run())
        runs[-1].statuses.append(status)
    return runs


def _is_new_run(before: StatusNote, status: StatusNote) -> bool:
    """Return whether a status belongs to a later run than the previous status.

    Two threads of a monitor publish, so statuses may arrive in the wrong order. A restart takes
    longer than that.
    """
    fell = any(status.count(key) < before.count(key) for key in _COUNTS)
    is_far = before.count("blocks") - status.count("blocks") > _MOST_LATE
    return fell and (is_far or status.sent_ns - before.sent_ns > _LATE_NS)


def _deal(answers: list[Answer], runs: list[Run]) -> None:
    """Assign the answers to runs. Between two runs the number of the window decides."""
    place = 0
    for answer in answers:
        while place + 1 < len(runs) and answer.sent_ns >= runs[place + 1].first_ns:
            place += 1
        if not runs:
            runs.append(Run())
        numbers = [item.window for item in runs[place].answers]
        is_between = runs[place].statuses and answer.sent_ns > runs[place].last_ns
        if is_between and place + 1 < len(runs) and numbers and answer.window < numbers[-1]:
            place += 1
        runs[place].answers.append(answer)


def _twice(actuator: _Actuator, _: Lost) -> Iterator[str]:
    for run in actuator.runs:
        for number, times in Counter(item.window for item in run.answers).items():
            if times > 1:
                yield f"window {number} has {times} answers in one run of the monitor"
    ends = Counter(item.end_ns for item in actuator.answers if item.valid)
    for end_ns, times in ends.items():
        if times > 1 and times > actuator.times_sent(end_ns):
            yield f"the window that ends at {end_ns} ns was identified {times} times"


def _unanswered(actuator: _Actuator, lost: Lost) -> Iterator[str]:
    for run in actuator.runs:
        answers = sorted(run.answers, key=lambda item: item.window)
        missing = [
            number
            for early, late in pairwise(answers)
            if not actuator.missed_ns(*sorted((early.sent_ns, late.sent_ns)))
            for number in range(early.window + 1, late.window)
        ]
        if len(missing) > lost.estimates:
            yield (
                f"windows {_some(missing)} of a run have no answer, and the recorder lost "
                f"{lost.estimates} of them"
            )
        yield from _counted(actuator, run, lost)
    answered = {(item.start_ns, item.end_ns) for item in actuator.answers}
    silent = [
        window
        for window in actuator.found
        if (window.start_ns, window.end_ns) not in answered
        and _had_to_answer(actuator, window)
        and not actuator.missed_ns(window.sent_ns, window.sent_ns + round(ANSWER_S * _NS))
    ]
    if len(silent) > lost.estimates:
        ends = _some([window.end_ns for window in silent])
        yield f"windows in the telemetry that end at {ends} ns have no answer"


def _counted(actuator: _Actuator, run: Run, lost: Lost) -> Iterator[str]:
    """Yield an error if more windows were counted than answered, up to ``ANSWER_S`` ago."""
    old = [item for item in run.counted() if run.last_ns - item.sent_ns > ANSWER_S * _NS]
    if len(old) < 2:
        return
    first, last = old[0], old[-1]
    counted = last.count("windows") - first.count("windows")
    answered = sum(
        first.count("windows") <= item.window < last.count("windows") for item in run.answers
    )
    unseen = lost.estimates + actuator.possibly_missed(first.sent_ns, run.last_ns)
    if counted - answered > unseen:
        yield f"{counted} windows were counted, {answered} answered, {lost.estimates} answers lost"


def _had_to_answer(actuator: _Actuator, window: FoundWindow) -> bool:
    """Return whether a monitor was running, received all of a window and had time to answer."""
    duration_ns = window.end_ns - window.start_ns
    start_ns = window.sent_ns - duration_ns - round(_STATUS_S * _NS)
    if window.sent_ns + ANSWER_S * _NS > actuator.end_ns:
        return False
    for run in actuator.runs:
        # A monitor that stood still detects a loss later.
        statuses = run.around(start_ns, window.sent_ns + round(ANSWER_S * _NS))
        if statuses is None:
            continue
        before, after = statuses
        if not before.count("blocks"):
            return False
        heard_all = all(
            before.count(key) == after.count(key) for key in ("samples lost", "defects")
        )
        return heard_all and window.sent_ns > run.recorded_from_ns
    return False


def _refused_health(actuator: _Actuator, lost: Lost) -> Iterator[str]:
    sent: dict[int, int] = {}
    for item in actuator.answers:
        if item.valid:
            sent.setdefault(item.end_ns, item.sent_ns)
    refused = {item.end_ns for item in actuator.answers if not item.valid} - sent.keys()
    first_ns = min((item.sent_ns for item in actuator.answers), default=actuator.end_ns)
    unknown = []
    for health in actuator.healths:
        if health.stamp_ns in refused:
            yield f"the health of {health.stamp_ns} ns is of a test that was refused"
        elif health.stamp_ns in sent:
            if sent[health.stamp_ns] > health.sent_ns:
                yield f"the health of {health.stamp_ns} ns was sent before its estimate"
        elif (
            health.stamp_ns
            and health.sent_ns > first_ns
            and not _is_resumed(actuator, health)
            and not actuator.missed_ns(health.stamp_ns, health.sent_ns)
        ):
            unknown.append(health.stamp_ns)
    if len(unknown) > lost.estimates:
        yield f"the healths of {_some(unknown)} ns have no estimate, {lost.estimates} were lost"


def _is_resumed(actuator: _Actuator, health: HealthNote) -> bool:
    """Return whether a health belongs to a test in the unit's history, before the record."""
    return not actuator.blocks or health.stamp_ns < actuator.blocks[0].stamp_ns


def _order(actuator: _Actuator, _: Lost) -> Iterator[str]:
    for run in actuator.runs:
        for early, late in zip(run.answers, run.answers[1:], strict=False):
            if late.window < early.window:
                yield f"the answer to window {late.window} came after the answer to {early.window}"
            went_back = actuator.goes_back_between(early.sent_ns, late.sent_ns)
            if late.window > early.window and late.end_ns <= early.end_ns and not went_back:
                yield f"window {late.window} ends before window {early.window}"
    for early, late in zip(actuator.healths, actuator.healths[1:], strict=False):
        if late.stamp_ns < early.stamp_ns and not actuator.goes_back_between(
            early.sent_ns, late.sent_ns
        ):
            yield f"the health of {late.stamp_ns} ns came after the health of {early.stamp_ns} ns"


def _stamps(actuator: _Actuator, _: Lost) -> Iterator[str]:
    for item in actuator.answers:
        if not actuator.is_simulated and item.sent_ns < item.end_ns - _AHEAD_NS:
            yield f"window {item.window}: its answer was sent before its end"
    for early, late in zip(actuator.blocks, actuator.blocks[1:], strict=False):
        if late.first_index == early.first_index + early.samples:
            due_ns = early.stamp_ns + round(early.samples * early.period_s * _NS)
            if late.stamp_ns < due_ns - _STAMP_NS and not actuator.is_simulated:
                yield f"block {late.first_index}: its stamp is {due_ns - late.stamp_ns} ns early"


def _found_only(status: StatusNote) -> int:
    """Return the number of windows that a status counts as found and not yet answered."""
    answered = status.count("estimates valid") + status.count("estimates invalid")
    return status.count("windows") - answered


def _counters(actuator: _Actuator, lost: Lost) -> Iterator[str]:
    for run in actuator.runs:
        statuses = run.counted()
        if len(statuses) < 2:
            continue
        first, last = statuses[0], statuses[-1]
        unseen = lost.estimates + actuator.possibly_missed(first.sent_ns, last.sent_ns)
        for key, wanted in (("estimates valid", True), ("estimates invalid", False)):
            counted = last.count(key) - first.count(key)
            within = [
                item
                for item in run.answers
                if item.valid == wanted and first.sent_ns < item.sent_ns <= last.sent_ns
            ]
            # At either end, a window may be between its answer and its count.
            if not -1 <= counted - len(within) <= 1 + unseen:
                yield f"{counted} {key} were counted, {len(within)} published"
        dropped = last.count("windows dropped") - first.count("windows dropped")
        reported = sum(
            item.dropped and first.sent_ns < item.sent_ns <= last.sent_ns for item in run.answers
        )
        # A window is counted when it is dropped, but its answer waits behind earlier answers.
        if not -1 - _found_only(first) <= dropped - reported <= 1 + _found_only(last) + unseen:
            yield f"{dropped} windows dropped were counted, {reported} published"
    stretches = _stretches(actuator.blocks, actuator.player_jumps_ns)
    missing = sum(_published(stretch) - len(stretch) for stretch in stretches)
    if missing > lost.telemetry:
        printed = lost.telemetry
        yield f"{missing} blocks are not in the bag, and the recorder reports {printed} lost"


def _published(stretch: list[Block]) -> int:
    size = max(block.samples for block in stretch)
    samples = stretch[-1].first_index + stretch[-1].samples - stretch[0].first_index
    return max(len(stretch), round(samples / size) if size else 0)


def _stretches(blocks: list[Block], jumps_ns: list[int]) -> Iterator[list[Block]]:
    """Yield the stretches of blocks between starts of their publisher or jumps of a replay."""
    stretch: list[Block] = []
    for block in blocks:
        if stretch and (
            block.first_index <= stretch[-1].first_index
            or any(stretch[-1].sent_ns < at_ns <= block.sent_ns for at_ns in jumps_ns)
        ):
            yield stretch
            stretch = []
        stretch.append(block)
    if stretch:
        yield stretch


def _end_ns(block: Block) -> int:
    return block.stamp_ns + round((block.samples - 1) * block.period_s * _NS)


def _some(values: list[int]) -> str:
    more = f" and {len(values) - 5} more" if len(values) > 5 else ""
    return ", ".join(map(str, values[:5])) + more


_RULES: Final[dict[str, Callable[[_Actuator, Lost], Iterator[str]]]] = {
    "identified twice": _twice,
    "unanswered": _unanswered,
    "health of a refused test": _refused_health,
    "order": _order,
    "stamps": _stamps,
    "counters": _counters,
}
