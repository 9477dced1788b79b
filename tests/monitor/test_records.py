# SPDX-License-Identifier: Apache-2.0
"""A record is motion cut only by the position, for any sensor and any blocks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from ema_core.acquisition import Acquisition
from ema_core.commands import THESIS_CHIRP, build_cycle
from ema_core.description import ActuatorDescription
from ema_core.telemetry import Telemetry
from ema_monitor.reasons import MalformedBlock, PieceTooShort
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.records import MOST_RECORD_SAMPLES, RecordTrigger, stands_still
from ema_monitor.windows.trigger import ANY_MOTION, Defect, Refusal, TriggerSettings
from ema_monitor.windows.window import Window
from ema_sim.actuator import SimulatedActuator

from .streams import sentence

H = 0.01
UNKNOWN = ActuatorDescription(sample_period=H, drive="unknown")
START_NS = 1_700_000_000_000_000_000
QUANTUM = 2.0 * np.pi / 4096.0
"""Step of an encoder of 12 bits [rad]."""


def rest(seconds: float, h: float = H) -> NDArray[np.float64]:
    return np.zeros(round(seconds / h))


def sine(seconds: float, amplitude: float = 0.3, h: float = H) -> NDArray[np.float64]:
    """Return motion at 1 Hz, which begins and ends at the angle 0."""
    return amplitude * np.sin(2.0 * np.pi * h * np.arange(1.0, round(seconds / h) + 1.0))


def telemetry(
    position: NDArray[np.float64], h: float = H, first_index: int = 1, *, command: bool = True
) -> Telemetry:
    n = len(position)
    stamp_ns = START_NS + round(first_index * h * 1e9)
    commanded = position if command else np.empty(0)
    return Telemetry(stamp_ns, h, first_index, commanded, np.zeros(n), position, np.zeros(n))


def events_of(
    whole: Telemetry, sizes: int | list[int] = 10, settings: TriggerSettings | None = None
) -> list[Segment | Defect]:
    finder = WindowFinder(
        settings or TriggerSettings(), replace(UNKNOWN, sample_period=whole.sample_period)
    )
    if isinstance(sizes, int):
        sizes = [sizes] * (len(whole) // sizes + 1)
    events, start = list[Segment | Defect](), 0
    for size in sizes:
        if stop := min(start + size, len(whole)) - start:
            events += finder.feed(whole.part(start, start + stop))
            start += stop
    return events + finder.finish()


def spans(events: list[Segment | Defect]) -> list[tuple[int, int, int]]:
    """Return first index, number of samples to the last, and first stamp of each record."""
    records = []
    for event in events:
        assert isinstance(event, Segment), event
        assert isinstance(event.window, Window), event
        samples, omitted = event.window.telemetry, sum(map(len, event.window.omitted))
        records.append((samples.first_index, len(samples) + omitted, samples.stamp_ns))
    return records


def seconds(events: list[Segment | Defect], h: float = H) -> list[tuple[float, float]]:
    """Return begin and end of each record [s]."""
    return [((first - 1) * h, (first - 1 + count) * h) for first, count, _ in spans(events)]


def random_day(seed: int) -> NDArray[np.float64]:
    """Return the position over some minutes: moves and rests, with noise and encoder steps."""
    random = np.random.default_rng(seed)
    pieces, at = [], 0.0
    for _ in range(60):
        goal, n = random.uniform(-1.0, 1.0), int(random.uniform(20, 300))
        pieces.append(at + (goal - at) * (0.5 - 0.5 * np.cos(np.pi * np.arange(1, n + 1) / n)))
        at = goal
        pieces.append(np.full(int(random.choice([1, 20, 100, 450, 800])), at))
    position = np.concatenate(pieces)
    position += random.choice([0.0, 1e-4]) * random.standard_normal(len(position))
    quantum = random.choice([0.0, QUANTUM])
    return np.round(position / quantum) * quantum if quantum else position


@pytest.mark.parametrize("seed", range(8))
def test_records_do_not_depend_on_the_sizes_of_blocks(seed: int):
    """The records are the same in one block as in blocks of 1 to 700 samples."""
    whole = telemetry(random_day(seed))
    settings = TriggerSettings(record_s=20.0)
    once = spans(events_of(whole, len(whole), settings))
    assert len(once) >= 3
    random = np.random.default_rng(100 + seed)
    for most in (3, 40, 700):
        sizes = random.integers(1, most + 1, len(whole)).tolist()
        assert spans(events_of(whole, sizes, settings)) == once


@pytest.mark.parametrize("seed", range(8))
def test_records_neither_overlap_nor_exceed_twice_their_length(seed: int):
    records = spans(events_of(telemetry(random_day(seed)), settings=TriggerSettings(record_s=20.0)))
    for (first, count, _), (following, _, _) in pairwise(records):
        assert first + count <= following
    assert all(2.0 <= count * H <= 40.0 for _, count, _ in records)


@pytest.mark.parametrize("h", [0.04, 0.01, 0.001])
def test_file_of_25_s_with_short_rests_is_one_record(h: float):
    moves = np.concatenate([np.concatenate([sine(2.0, h=h), rest(3.0, h)]) for _ in range(5)])
    [(first, count, _)] = spans(events_of(telemetry(moves, h), 10))
    # Everything except the last rest after its first 0.5 s; the end of the motion is known to
    # 0.04 s.
    assert first == 1
    assert count * h == pytest.approx(25.0 - 3.0 + 0.5, abs=0.1)


def test_rest_of_5_s_ends_a_record_at_once_and_half_a_second_of_rest_remains():
    position = np.concatenate([rest(8.0), sine(6.0), rest(30.0), sine(4.0), rest(10.0)])
    finder, record_ends = WindowFinder(TriggerSettings(), UNKNOWN), list[float]()
    for number in range(0, len(position), 10):
        if finder.feed(telemetry(position[number : number + 10], first_index=number + 1)):
            record_ends.append((number + 10) * H)
    # Bins of 0.04 s are processed 12 at a time.
    assert record_ends == pytest.approx([19.0 + 0.3, 53.0 + 0.3], abs=0.35)
    # Motion begins and ends within a bin; at the turning points of the sine, its speed is 0.
    ends = seconds(events_of(telemetry(position)))
    assert ends == [pytest.approx(span, abs=0.1) for span in ((7.5, 14.5), (43.5, 48.5))]


def test_long_motion_ends_at_the_first_rest_after_record_s():
    moves = np.concatenate([np.concatenate([sine(7.0), rest(1.0)]) for _ in range(20)])
    first, second, third = seconds(events_of(telemetry(moves)))
    # The first rest after 60 s begins at 63 s, and the first rest of the next record at 127 s.
    assert first == pytest.approx((0.0, 63.25), abs=0.1)
    assert second == pytest.approx((63.5, 127.25), abs=0.1)
    assert third == pytest.approx((127.5, 159.5), abs=0.1)


def test_motion_without_rest_ends_at_twice_record_s_and_loses_no_sample():
    records = spans(events_of(telemetry(sine(300.0))))
    # 120 s, in whole bins of 4 samples; the first begins within a bin.
    assert [count * H for _, count, _ in records] == pytest.approx([120.0, 120.0, 60.0], abs=0.09)
    assert sum(count for _, count, _ in records) == 30_000
    assert [first for first, _, _ in records][1:] == [
        first + count for first, count, _ in records[:-1]
    ]


@pytest.mark.parametrize("more", range(-4, 5))
def test_telemetry_that_ends_with_a_full_record_gives_the_record(more: int):
    settings = TriggerSettings()
    whole = telemetry(sine(2.0 * settings.record_s + more * H))
    (record,) = spans(events_of(whole, 20, settings))
    assert record[0] <= 51
    assert record[1] > 2.0 * settings.record_s / H - 100


def test_short_remainder_belongs_to_the_record():
    """Five cycles of a ball screw last 64.8 s, and the trial is one record."""
    cycle = np.concatenate([np.linspace(0.0, 150.0, 125), np.full(37, 150.0)])
    cycle = np.concatenate([cycle, cycle[::-1]])
    noise = 0.05 * np.random.default_rng(1).standard_normal(5 * len(cycle))
    [(first, count, _)] = spans(events_of(telemetry(np.tile(cycle, 5) + noise, 0.04)))
    assert (first, count) == (1, 1620)


@pytest.mark.parametrize("gap", [101, 1000])
def test_gap_of_more_than_a_second_ends_a_record(gap: int):
    whole = telemetry(sine(10.0))
    first, second = whole.part(0, 500), whole.part(500, 1000)
    second = replace(second, first_index=501 + gap, stamp_ns=second.stamp_ns + gap * 10_000_000)
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    events = [*finder.feed(first), *finder.feed(second), *finder.finish()]
    defects = [event for event in events if isinstance(event, Defect)]
    records = spans([event for event in events if isinstance(event, Segment)])
    assert len(defects) == 1
    assert "gap of" in defects[0].reason
    assert [item[:2] for item in records] == [(1, 500), (501 + gap, 500)]


def test_rejected_block_and_changed_description_end_a_record():
    whole, finder = telemetry(sine(12.0)), WindowFinder(TriggerSettings(), UNKNOWN)
    assert finder.feed(whole.part(0, 400)) == []
    record, defect = finder.reject(whole.stamp_at(400), "no telemetry")
    assert isinstance(record, Segment)
    assert spans([record])[0][:2] == (1, 400)
    assert defect == Defect(whole.stamp_at(400), MalformedBlock("no telemetry"))
    finder.feed(whole.part(400, 800))
    replaced = replace(UNKNOWN, serial_number="B-2")
    record, defect = finder.describe(replaced)
    assert isinstance(record, Segment)
    # The record belongs to the unit that moved, not to the new one.
    assert record.description == UNKNOWN
    assert spans([record])[0][:2] == (401, 400)
    finder.feed(whole.part(800, 1200))
    [record] = finder.finish()
    assert isinstance(record, Segment)
    assert record.description == replaced


def test_two_units_that_publish_alternately_give_no_record():
    """Samples whose index goes back and forth come from two publishers."""
    whole, finder = telemetry(sine(20.0)), WindowFinder(TriggerSettings(), UNKNOWN)
    events = list[Segment | Defect]()
    for start in range(0, 900, 10):
        events += finder.feed(whole.part(start + 1000, start + 1010))
        events += finder.feed(whole.part(start, start + 10))
    events += finder.finish()
    assert events
    assert not any(isinstance(event, Segment) for event in events)


@pytest.mark.parametrize("amplitude", [0.03, 0.3, 3.0])
@pytest.mark.parametrize("noise", [0.0, 0.3 * QUANTUM])
def test_12_bit_encoder_that_toggles_at_rest_counts_as_resting(amplitude: float, noise: float):
    ideal = np.concatenate([rest(20.0), sine(8.0, amplitude), rest(20.0)]) + 0.5 * QUANTUM
    random = np.random.default_rng(3)
    position = ideal + noise * random.standard_normal(len(ideal))
    position = np.round(position / QUANTUM) * QUANTUM
    [span] = seconds(events_of(telemetry(position)))
    # A motion of 20 steps leaves the threshold of 4 steps within 0.05 s.
    assert span == pytest.approx((19.5, 28.5), abs=0.15)


@pytest.mark.parametrize("sigma", [1e-6, 1e-4, 3e-3])
@pytest.mark.parametrize("h", [0.04, 0.01, 0.001])
def test_noise_at_rest_is_not_motion(sigma: float, h: float):
    ideal = np.concatenate([rest(120.0, h), sine(8.0, h=h), rest(120.0, h)])
    position = ideal + sigma * np.random.default_rng(4).standard_normal(len(ideal))
    [span] = seconds(events_of(telemetry(position, h), round(1.0 / h)), h)
    # At 25 Hz, the threshold of 8 sigma is left after 0.04 s; margins are whole bins.
    assert span == pytest.approx((119.5, 128.5), abs=0.2)


def test_slow_rotation_after_fast_rotation_is_motion():
    """A wheel at 100 rad/s has turned by 4,000 rad when it slows down to 5 rad/s."""
    speed = np.concatenate([np.full(4000, 100.0), np.full(1000, 5.0), np.full(1000, 100.0)])
    position = np.cumsum(speed) * H
    [(first, count, _)] = spans(events_of(telemetry(position)))
    assert (first, count) == (1, 6000)


def test_small_motion_after_a_large_one_belongs_to_the_record():
    """Strokes of 0.5 mrad for 20 s follow 4 s after a move of 1 rad."""
    move = 0.5 - 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, 300))
    small = 1.0 + 0.00025 * sine(20.0, 1.0)
    position = np.concatenate([move, np.ones(400), small, np.ones(1000)])
    [(_, end)] = seconds(events_of(telemetry(position)))
    assert end == pytest.approx(27.5, abs=0.1)


def test_hours_of_rest_use_no_memory_and_give_no_record():
    trigger = RecordTrigger(UNKNOWN.parameters)
    noise = 1e-4 * np.random.default_rng(5).standard_normal(6000)
    drift = np.linspace(0.0, 2e-4, 6000)
    for minute in range(120):
        block = telemetry(noise + drift, first_index=1 + 6000 * minute)
        for start in range(0, 6000, 100):
            assert trigger.feed(block.part(start, start + 100)) == []
        # 0.5 s before the samples that have no bin so far, in blocks of 1 s.
        assert trigger.kept_samples <= 300
    assert trigger.finish() == []


@pytest.mark.parametrize(("h", "longest_s"), [(1e-4, 20.0), (2e-3, 120.0)])
@pytest.mark.parametrize("size", [1, 1000])
def test_memory_is_limited_at_any_rate_and_size_of_blocks(h: float, longest_s: float, size: int):
    """At 10 kHz, a record of motion without rest has 20 s; at 500 Hz, it has 120 s."""
    seconds_fed = 1.1 * longest_s
    if size == 1:
        h, seconds_fed, longest_s = h * 10.0, seconds_fed, min(120.0, 10.0 * longest_s)
    whole = telemetry(sine(seconds_fed, h=h), h)
    trigger = RecordTrigger(UNKNOWN.parameters)
    records, most, parts = [], 0, 0
    for start in range(0, len(whole), size):
        records += trigger.feed(whole.part(start, min(start + size, len(whole))))
        most, parts = max(most, trigger.kept_samples), max(parts, trigger._latest.parts)
    longest = min(MOST_RECORD_SAMPLES, round(120.0 / h))
    assert most <= longest + 13 * round(0.04 / h) + size
    # Blocks of one sample are joined in groups of 64.
    assert parts <= longest / max(size, 64) + 70
    for record in records:
        assert len(record.telemetry) * h == pytest.approx(longest_s, abs=0.08)


def test_drive_without_position_command_is_recorded_by_its_position():
    unit = replace(UNKNOWN, acquisition=Acquisition(command=False))
    whole = telemetry(np.concatenate([rest(2.0), sine(6.0), rest(8.0)]), command=False)
    finder = WindowFinder(TriggerSettings(), unit)
    [record] = [*finder.feed(whole), *finder.finish()]
    assert isinstance(record, Segment)
    assert isinstance(record.window, Window)
    assert record.window.excitation == pytest.approx(0.6)
    assert "the position travels 600.0 mrad" in str(record.window)


@pytest.mark.parametrize("command", ["constant", "equal", "noise"])
def test_command_does_not_affect_the_records(command: str):
    position = np.concatenate([rest(2.0), sine(6.0), rest(8.0)])
    whole = telemetry(position)
    random = np.random.default_rng(6)
    commands = {
        "constant": np.full(len(position), 7.0),
        "equal": position,
        "noise": random.standard_normal(len(position)),
    }
    assert spans(events_of(replace(whole, command=commands[command]))) == spans(events_of(whole))


@pytest.mark.parametrize("windows", ["test_cycle", ANY_MOTION])
def test_record_is_never_a_stretch_for_any_requested_windows(windows: str):
    events = events_of(telemetry(sine(6.0)), settings=TriggerSettings(windows=windows))
    [record] = events
    assert isinstance(record, Segment)
    assert not record.is_stretch


@pytest.mark.parametrize(
    ("position", "reason"),
    [
        # Motion is counted in bins of 0.04 s.
        (sine(1.0), "a record needs 2 s of motion, and the longest piece has 0.96 s"),
        (
            sine(5.0, 4e-4),
            "a record needs a travel of 0.001 rad, and the position travels 0.0008 rad",
        ),
    ],
)
def test_piece_without_enough_motion_is_ignored_with_the_reason(
    position: NDArray[np.float64], reason: str
):
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    for number in range(1, 4):
        whole = np.concatenate([rest(1.0), position, rest(1.0)])
        begin = 1 + 10_000 * number
        events = finder.feed(telemetry(whole, first_index=begin))
        assert not any(isinstance(event, Segment) for event in [*events, *finder.finish()])
        assert finder.passed_over == number
    assert finder.windows == 0
    assert finder.shortfall == finder.obstacle
    assert sentence(finder.shortfall) == reason


def test_telemetry_in_short_pieces_is_reported():
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    for number in range(8):
        finder.feed(telemetry(sine(1.0), first_index=1 + 250 * number))
    assert sentence(finder.obstacle) == (
        "a record needs 2 s of motion, and the telemetry has at most 1 s without a gap "
        "(1050 samples lost)"
    )


def chirps(count: int) -> Telemetry:
    """Return half-second test cycles of the simulated flap, one after another."""
    actuator = SimulatedActuator(sample_period=1e-3)
    cycle = build_cycle(THESIS_CHIRP, 1e-3).samples
    return actuator.advance(np.tile(cycle, count))


def test_ten_test_cycles_are_one_record_and_a_single_one_is_ignored():
    ten = chirps(10)
    [(first, count, _)] = spans(events_of(ten))
    assert count >= 0.95 * len(ten)
    assert first <= 0.05 * len(ten)
    finder = WindowFinder(TriggerSettings(), replace(UNKNOWN, sample_period=1e-3))
    assert [*finder.feed(chirps(1)), *finder.finish()] == []
    assert finder.passed_over == 1
    assert isinstance(finder.shortfall, PieceTooShort)


def test_stamps_that_contradict_the_sample_period_refuse_the_record():
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    events = list[Segment | Defect]()
    for number, start in enumerate(range(0, 1000, 100)):
        block = telemetry(sine(10.0)).part(start, start + 100)
        events += finder.feed(replace(block, stamp_ns=START_NS + number * 1_100_000_000))
    [record] = [*events, *finder.finish()]
    assert isinstance(record, Segment)
    assert isinstance(record.window, Refusal)
    assert record.window.reason == ("the stamps give one sample every 0.011 s, the blocks 0.01 s")


@pytest.mark.parametrize("size", [1, 7, 250])
def test_record_has_the_stamp_of_the_block_in_which_it_begins(size: int):
    """The clock drifts by 100 ppm: a cut of joined blocks has the stamp of its own block."""
    position = np.concatenate([rest(20.0), sine(6.0), rest(8.0)])
    whole, finder = telemetry(position), WindowFinder(TriggerSettings(), UNKNOWN)
    events, blocks = list[Segment | Defect](), list[Telemetry]()
    for start in range(0, len(whole), size):
        block = whole.part(start, min(start + size, len(whole)))
        blocks.append(replace(block, stamp_ns=block.stamp_ns + 1000 * start))
        events += finder.feed(blocks[-1])
    [(first, _, stamp_ns)] = spans(events)
    [own_block] = [part for part in blocks if 0 <= first - part.first_index < len(part)]
    assert stamp_ns == own_block.stamp_at(first - own_block.first_index)


def test_rate_too_high_for_a_record_is_named():
    finder = WindowFinder(TriggerSettings(), UNKNOWN)
    [defect] = finder.feed(replace(telemetry(rest(1.0)), sample_period=1e-6))[1:]
    assert isinstance(defect, Defect)
    assert "a record of 2 s would have 2,000,000 samples, expected at most 100,000" in defect.reason


@pytest.mark.parametrize("first_index", [2**53, 2**63 - 300, 2**63, 2**64 - 700])
def test_record_is_detected_at_any_running_index(first_index: int):
    position = np.concatenate([rest(1.0), sine(4.0), rest(7.0)])
    lengths = []
    for index in (first_index, 4 + first_index % 4):
        whole = replace(telemetry(position), first_index=index)
        [(first, count, _)] = spans(events_of(whole))
        lengths.append((first - index, count))
    assert lengths[0] == lengths[1]


def seized(seconds: float, angle: float = 0.1, h: float = H) -> Telemetry:
    """Return telemetry in which the command moves but the position has only encoder noise."""
    n = round(seconds / h)
    counts = np.random.default_rng(3).integers(0, 2, n).astype(np.float64)
    return replace(telemetry(angle + QUANTUM * counts, h), command=sine(seconds, h=h))


def records_of(
    whole: Telemetry, size: int = 10, settings: TriggerSettings | None = None
) -> list[Window]:
    records = []
    for event in events_of(whole, size, settings):
        assert isinstance(event, Segment)
        assert isinstance(event.window, Window)
        records.append(event.window)
    return records


@pytest.mark.parametrize("size", [1, 10, 100])
def test_position_that_stands_still_although_the_command_moves_is_a_record(size):
    whole = seized(100.0)
    records = records_of(whole, size, TriggerSettings(record_s=30.0))
    assert sum(len(record.telemetry) for record in records) == len(whole)
    # A decision waits for the bins of one second.
    assert [len(window.telemetry) * H for window in records[:3]] == pytest.approx(
        [30.0] * 3, abs=1.0
    )
    assert not events_of(seized(1.5), size)


def test_position_that_seizes_in_motion_is_a_second_record():
    moving, stuck = sine(20.0), seized(30.0, 0.0).position
    whole = telemetry(np.concatenate([moving, stuck]))
    whole = replace(whole, command=sine(50.0))
    first, second = records_of(whole)
    assert len(first.telemetry) * H == pytest.approx(20.5, abs=0.2)
    assert stands_still(second.telemetry)
    assert not stands_still(first.telemetry)
    assert second.end_ns == whole.stamp_at(len(whole) - 1)


def test_rest_and_a_position_without_a_command_are_not_a_standstill():
    stuck = seized(30.0)
    for quiet in (replace(stuck, command=np.empty(0)), replace(stuck, command=rest(30.0))):
        assert not events_of(quiet)


def test_memory_of_a_standstill_is_limited():
    trigger = RecordTrigger(UNKNOWN.parameters, TriggerSettings(record_s=20.0))
    whole, most = seized(200.0), 0
    for start in range(0, len(whole), 10):
        trigger.feed(whole.part(start, start + 10))
        most = max(most, trigger.kept_samples)
    assert most * H < 23.0


def test_longer_rest_belongs_to_a_record_if_the_setting_allows_it():
    work = np.concatenate([rest(3.0), *[part for _ in range(4) for part in (sine(6.0), rest(8.0))]])
    apart = seconds(events_of(telemetry(work)))
    assert len(apart) == 4
    together = seconds(events_of(telemetry(work), settings=TriggerSettings(record_rest_s=20.0)))
    assert together == [pytest.approx((apart[0][0], apart[3][1]), abs=0.6)]


def test_records_begin_at_least_an_interval_apart_and_skipped_motion_is_not_kept():
    work = np.concatenate(
        [rest(3.0), *[part for _ in range(40) for part in (sine(6.0), rest(1.0))]]
    )
    settings = TriggerSettings(record_s=10.0, record_interval_s=60.0)
    records = seconds(events_of(telemetry(work), settings=settings))
    begins = [begin for begin, _ in records]
    assert len(records) == 5
    assert min(np.diff(begins)) >= 60.0
    trigger = RecordTrigger(UNKNOWN.parameters, settings)
    kept = []
    whole = telemetry(work)
    for start in range(0, len(whole), 10):
        trigger.feed(whole.part(start, min(start + 10, len(whole))))
        kept.append(trigger.kept_samples)
    assert max(kept) * H < 25.0
    assert kept[round(40.0 / H / 10)] * H < 2.0


def test_short_end_of_a_motion_is_the_remainder_of_its_records():
    def remainders(work, **settings):
        events = events_of(telemetry(work), settings=TriggerSettings(record_s=10.0, **settings))
        return [
            event.window.is_remainder
            for event in events
            if isinstance(event, Segment) and isinstance(event.window, Window)
        ]

    motion = [part for _ in range(3) for part in (sine(6.0), rest(1.0))]
    assert remainders(np.concatenate([rest(3.0), *motion])) == [False, True]
    # A short motion alone, or after a long rest, is a separate record.
    assert remainders(np.concatenate([rest(3.0), sine(6.0)])) == [False]
    apart = np.concatenate([rest(3.0), *motion[:4], rest(9.0), sine(6.0)])
    assert remainders(apart) == [False, False]
    assert remainders(apart, record_rest_s=20.0) == [False, True]


def paused_work(pause_s: float, h: float = H) -> NDArray[np.float64]:
    """Return motions of 6 s at slightly different offsets, with noise, and pauses between them."""
    random = np.random.default_rng(3)
    parts = [part for _ in range(8) for part in (sine(6.0, h=h), rest(pause_s, h))]
    work = np.concatenate([rest(3.0, h), *parts])
    return work + 1e-6 * random.standard_normal(len(work))


def kept_in(window: Window, whole: Telemetry) -> NDArray[np.bool_]:
    """Return flags of the samples that a window keeps, for telemetry with first index 1."""
    kept = np.zeros(len(whole), dtype=bool)
    first = window.telemetry.first_index - 1
    kept[first : first + len(window.telemetry) + sum(map(len, window.omitted))] = True
    for omitted in window.omitted:
        kept[omitted.start - 1 : omitted.stop - 1] = False
    return kept


@pytest.mark.parametrize("sizes", [1, 10, 170, 5000])
def test_long_rests_are_left_out_of_a_record(sizes: int):
    """Work of 6 s every 66 s gives records with as much motion as work without pauses."""
    whole = telemetry(paused_work(60.0))
    settings = TriggerSettings(record_s=20.0, record_rest_s=600.0)
    events = events_of(whole, sizes, settings)
    windows = [event.window for event in events if isinstance(event, Segment)]
    assert [len(window.omitted) for window in windows if isinstance(window, Window)] == [2, 2, 1]
    for window in windows:
        assert isinstance(window, Window)
        kept = kept_in(window, whole)
        np.testing.assert_array_equal(window.telemetry.position, whole.position[kept])
        assert window.end_ns == whole.stamp_at(int(np.flatnonzero(kept)[-1]))
        assert all(58.0 < len(omitted) * H < 60.0 for omitted in window.omitted)


def long_day(seed: int) -> NDArray[np.float64]:
    """Return moves, rests up to 40 s and creep up to 90 s, with noise and slow oscillation."""
    random = np.random.default_rng(seed)
    parts, base = [rest(3.0)], 0.0
    for kind in random.choice(["move", "rest", "creep"], random.integers(5, 40), p=[0.5, 0.3, 0.2]):
        if kind == "move":
            parts.append(base + sine(float(random.integers(1, 25))))
        elif kind == "rest":
            parts.append(base + rest(random.uniform(0.2, 40.0)))
        else:
            creep = random.choice([1e-5, 1e-4, 3e-4])
            parts.append(base + np.linspace(0.0, creep, round(random.uniform(3.0, 90.0) / H)))
            base += creep
    day = np.concatenate(parts)
    slow = np.sin(2.0 * np.pi * np.arange(len(day)) * H / random.uniform(3.0, 300.0))
    noise = random.choice([0.0, 1e-6, 2e-5]) * random.standard_normal(len(day))
    return day + noise + random.choice([0.0, 3e-5]) * slow


@pytest.mark.parametrize("seed", range(12))
def test_records_with_long_rests_keep_the_right_samples_for_any_size_of_blocks(seed: int):
    random = np.random.default_rng(seed + 1000)
    whole = telemetry(long_day(seed), command=bool(random.integers(2)))
    settings = TriggerSettings(
        record_s=float(random.choice([5.0, 20.0, 40.0])),
        record_rest_s=float(random.choice([5.0, 20.0, 600.0])),
        record_interval_s=float(random.choice([0.0, 60.0])),
    )
    results = []
    for size in (7, 100, 3000):
        events = events_of(whole, size, settings)
        windows = [event.window for event in events if isinstance(event, Segment)]
        for window in windows:
            assert isinstance(window, Window)
            kept = kept_in(window, whole)
            np.testing.assert_array_equal(window.telemetry.position, whole.position[kept])
            assert window.end_ns == whole.stamp_at(int(np.flatnonzero(kept)[-1]))
            assert len(window) <= 2.0 * settings.record_s / H
        assert all(first.end_ns < second.start_ns for first, second in pairwise(windows))
        results.append([(window.start_ns, window.end_ns) for window in windows])
    assert results[0] == results[1] == results[2]


def test_rests_of_a_record_use_little_memory():
    """At most the joined blocks at the ends of each rest remain, 6.4 s each."""
    trigger = RecordTrigger(UNKNOWN.parameters, TriggerSettings(record_s=40.0, record_rest_s=600.0))
    whole = telemetry(paused_work(400.0))
    kept = []
    for start in range(0, len(whole), 10):
        trigger.feed(whole.part(start, min(start + 10, len(whole))))
        kept.append(trigger.kept_samples)
    assert max(kept) * H < 100.0


@pytest.mark.parametrize("sizes", [10, 1000])
def test_joint_that_seizes_in_a_pause_of_its_work_is_detected_after_5_s(sizes: int):
    work = paused_work(60.0)
    whole = telemetry(work)
    moving = round((3.0 + 6.0 + 20.0) / H)
    command = whole.command.copy()
    command[moving : moving + round(30.0 / H)] = sine(30.0)
    settings = TriggerSettings(record_s=20.0, record_rest_s=600.0)
    events = events_of(replace(whole, command=command), sizes, settings)
    still = [
        event
        for event in events
        if isinstance(event, Segment)
        and isinstance(event.window, Window)
        and stands_still(event.window.telemetry)
    ]
    assert still
    first = still[0].window
    assert isinstance(first, Window)
    assert first.start_ns < whole.stamp_at(moving + round(10.0 / H))


def test_position_that_creeps_at_rest_does_not_jump_where_the_rest_is_left_out():
    """The joint sinks by ten times the noise in each pause."""
    pause = 2e-4 * np.sin(np.linspace(0.0, 0.5 * np.pi, round(120.0 / H)))
    parts = [
        part for number in range(6) for part in (sine(6.0) + number * 2e-4, pause + number * 2e-4)
    ]
    random = np.random.default_rng(5)
    work = np.concatenate([rest(3.0), *parts])
    whole = telemetry(work + 2e-5 * random.standard_normal(len(work)))
    settings = TriggerSettings(record_s=20.0, record_rest_s=600.0)
    windows = [
        event.window for event in events_of(whole, 10, settings) if isinstance(event, Segment)
    ]
    omitted = 0
    for window in windows:
        assert isinstance(window, Window)
        omitted += sum(map(len, window.omitted))
        splices = np.flatnonzero(np.diff(np.flatnonzero(kept_in(window, whole))) > 1)
        for splice in splices:
            around = window.telemetry.position[splice - 20 : splice + 22]
            assert abs(np.mean(around[:21]) - np.mean(around[21:])) < 8.5 * 2e-5
    assert omitted * H > 300.0
