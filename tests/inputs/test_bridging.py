# SPDX-License-Identifier: Apache-2.0
"""Live messages give the same telemetry as a bag of these messages."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from ema_bags.inputs.bridging import Bridge, BridgeSettings
from ema_bags.inputs.defect_wording import defect_text
from ema_bags.inputs.defects import not_finite
from ema_bags.inputs.publishers import two_publishers
from ema_bags.inputs.series import Collector
from ema_core.acquisition import Acquisition
from ema_core.telemetry import Telemetry
from ema_monitor.windows.finder import Segment, WindowFinder
from ema_monitor.windows.trigger import TriggerSettings
from ema_monitor.windows.window import Window

from .conftest import cycle, described, mapping_from
from .joint_motion import TAU as JOINT_TAU
from .joint_motion import joint, moves

START_NS = 1_700_000_000_000_000_000
TAU = 1 / 500
STATES, COMMANDS = "/joint_states", "/command"


def mapping(**changes):
    content = {
        "joint": "flap",
        "position": {"topic": STATES, "source": "position"},
        "speed": {"topic": STATES, "source": "velocity", "shaft": "user"},
        "current": {"topic": STATES, "source": "effort"},
        "command": {"topic": COMMANDS, "source": "data", "between": "hold"},
    }
    return mapping_from({k: v for k, v in (content | changes).items() if v is not None})


def bridge(of=None, rate_hz=1000, **settings):
    return Bridge(of or mapping(), described(rate_hz), BridgeSettings(**settings))


def collect(target: Bridge, topic, message, sent_ns, received_ns):
    """Pass a message to the collector of a bridge."""
    assert isinstance(target.collector, Collector)
    target.collector.add(topic, message, sent_ns, received_ns)


def state(telemetry, i, stamp_ns, **factors):
    stamp = SimpleNamespace(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    rows = {"position": telemetry.position, "velocity": telemetry.speed * TAU}
    rows["effort"] = telemetry.current
    values = {k: [0.0, row[i] * factors.get(k, 1.0)] for k, row in rows.items()}
    header = SimpleNamespace(stamp=stamp)
    return SimpleNamespace(header=header, name=["other", "flap"], **values)


def run(target, telemetry, stamps, *, every=10, stamped=True, sent=None, send_command=None, **of):
    """Send a cycle, with commands before states; return the output blocks."""
    blocks = []
    sent = stamps if sent is None else sent
    for i, stamp in enumerate(stamps):
        at = int(sent[i])
        if send_command is None or send_command(i):
            number = SimpleNamespace(data=telemetry.command[i])
            collect(target, COMMANDS, number, at - 1000, at + 10_000)
        message = state(telemetry, i, int(stamp) if stamped else 0, **of)
        collect(target, STATES, message, at, at + 10_000)
        if i % every == 0:
            blocks += target.advance()
    # The last position waits for earlier messages until a later command arrives.
    collect(target, COMMANDS, SimpleNamespace(data=0.0), int(sent[-1]) + 1000, int(sent[-1]) + 2000)
    return blocks + target.advance()


def stamps_of(telemetry, offset_ns=START_NS):
    return telemetry.stamps_ns + offset_ns


@pytest.mark.parametrize(("rate_hz", "every"), [(1000, 1), (500, 10), (1000, 333)])
def test_blocks_do_not_depend_on_the_arrival_of_messages(rate_hz, every):
    telemetry, target = cycle(rate_hz), bridge(rate_hz=rate_hz)
    blocks = run(target, telemetry, stamps_of(telemetry), every=every)
    for name in ("command", "current", "position", "speed"):
        joined = np.concatenate([getattr(block, name) for block in blocks])
        assert joined == pytest.approx(getattr(telemetry, name), rel=1e-12)
    assert [blocks[0].first_index, blocks[0].stamp_ns] == [1, stamps_of(telemetry)[0]]
    for before, after in pairwise(blocks):
        assert after.first_index == before.first_index + len(before)
    assert target.description is not None
    assert target.description.sample_period == 1.0 / rate_hz
    assert (target.defects, target.losses.lost) == ([], 0)


@pytest.mark.parametrize(
    ("rate_hz", "given_s", "block_s"), [(200, 0.01, 0.1), (1000, 0.01, 0.02), (1000, 0.05, 0.05)]
)
def test_blocks_of_a_slow_drive_are_longer_and_equally_long(rate_hz, given_s, block_s):
    telemetry, target = cycle(rate_hz), bridge(rate_hz=rate_hz, block_s=given_s)
    assert target.block_s == given_s  # The rate is unknown so far.
    every = round(block_s * rate_hz)
    *blocks, _ = run(target, telemetry, stamps_of(telemetry), every=every)
    assert target.block_s == pytest.approx(block_s)
    assert len(blocks) > 3
    assert all(every / 2 < len(block) < 2 * every for block in blocks)


def test_unmeasured_columns_are_empty_and_reported(telemetry):
    target = bridge(mapping(speed=None, current=None))
    blocks = run(target, telemetry, stamps_of(telemetry))
    assert all(len(block.speed) == len(block.current) == 0 for block in blocks)
    assert target.description is not None
    assert target.description.acquisition == Acquisition("none", 0.0, False)


def test_messages_without_a_stamp_get_regular_stamps(telemetry):
    rng = np.random.default_rng(0)
    stamps = stamps_of(telemetry)
    sent = stamps + np.rint(rng.exponential(1e5, len(stamps))).astype(np.int64)
    target = bridge()
    blocks = run(target, telemetry, stamps, stamped=False, sent=sent)
    assert target.rebuilt > 0
    assert "stamps_rebuilt" in {item.kind for item in target.defects}
    position = np.concatenate([block.position for block in blocks])
    # The last messages wait for their successors.
    assert len(telemetry) - 320 < len(position) < len(telemetry)
    assert position == pytest.approx(telemetry.position[: len(position)], rel=1e-12)


def test_command_that_is_sent_only_on_change_is_held(telemetry):
    target = bridge(wait_s=0.1)
    changes = np.flatnonzero(np.diff(telemetry.command, prepend=np.nan))
    blocks = run(target, telemetry, stamps_of(telemetry), send_command=set(changes).__contains__)
    command = np.concatenate([block.command for block in blocks])
    assert len(telemetry) - 120 < len(command)
    assert command == pytest.approx(telemetry.command[: len(command)], rel=1e-12)


def test_losses_leave_a_gap(telemetry):
    keep = np.ones(len(telemetry), bool)
    keep[1200:1203] = False
    target = bridge()
    number = np.flatnonzero(keep)
    blocks = []
    for i in number:
        at = int(stamps_of(telemetry)[i])
        collect(target, COMMANDS, SimpleNamespace(data=telemetry.command[i]), at - 1000, at)
        collect(target, STATES, state(telemetry, i, at), at, at)
        blocks += target.advance()
    assert target.losses.lost == 3
    indices = np.concatenate([b.first_index + np.arange(len(b)) for b in blocks])
    assert np.array_equal(indices, number[:-1] + 1)


@pytest.mark.parametrize(
    ("factors", "name"),
    [
        ({"effort": 0.0}, "current_zero"),
        ({"position": 57.29578}, "position_unit"),
        ({"velocity": -1.0}, "speed_sign_reversed"),
    ],
)
def test_telemetry_with_a_defect_is_withheld_before_a_window_is_complete(telemetry, factors, name):
    target = bridge()
    blocks = run(target, telemetry, stamps_of(telemetry), **factors)
    assert [item.kind for item in target.refused] == [name]
    moves = np.flatnonzero(telemetry.command != telemetry.command[-1])
    window_end = moves[-1]
    assert sum(len(block) for block in blocks) < window_end
    assert target.withheld > 0


def test_column_that_becomes_nan_after_good_data_is_an_error_with_its_name(telemetry):
    target, good = bridge(), stamps_of(telemetry)
    assert run(target, telemetry, good)
    cycle_ns = 1_000_000 * len(good)
    run(target, telemetry, good + cycle_ns, effort=np.nan)
    [defect] = target.refused
    assert defect.kind == "not_finite"
    assert "current is not finite in 1700 of 3000 samples" in defect_text(defect).problem
    assert "or omit current" in defect_text(defect).remedy
    run(target, telemetry, good + 2 * cycle_ns, effort=np.nan)
    assert "current is not finite in 3000 of 3000 samples" in defect_text(target.refused[0]).problem
    # After the column recovers, the defect disappears within seconds.
    blocks = run(target, telemetry, good + 3 * cycle_ns)
    assert target.refused == []
    assert blocks


def test_a_few_non_finite_samples_are_a_note():
    column = np.zeros(1000)
    column[:5] = np.nan
    [defect] = not_finite({"current": column, "speed": np.zeros(1000)})
    assert "current is not finite in 5 of 1000 samples" in defect_text(defect).problem
    assert not defect.is_error


def joint_bridge(of=None, **settings):
    """Return a bridge of a joint with an unknown controller and without a command."""
    mapped = of or mapping(command=None)
    description = joint(200.0)
    return Bridge(mapped, description, BridgeSettings(**settings))


def send_moves(
    target,
    seconds,
    *,
    begin=0,
    speed_factor=1.0,
    position=None,
    lost=(),
    publishers_ns=(0,),
    empty=(),
    order=None,
):
    """Send states of a joint at 200 Hz except the lost ones; return the output blocks.

    Each publisher sends all states, delayed by its entry in ``publishers_ns`` [ns]. The states in
    ``empty`` have zeros only.
    """
    columns, stamps = moves(seconds)
    place = columns["position"] if position is None else position
    blocks = []
    for i in range(begin, len(stamps)) if order is None else order:
        if i in lost:
            continue
        filled = float(i not in empty)
        for late_ns in publishers_ns:
            stamp = int(stamps[i]) + late_ns
            time = SimpleNamespace(sec=stamp // 10**9, nanosec=stamp % 10**9)
            message = SimpleNamespace(
                header=SimpleNamespace(stamp=time),
                name=["flap"],
                position=[place[i] * filled],
                velocity=[columns["speed"][i] * JOINT_TAU * speed_factor * filled],
                effort=[columns["current"][i] * filled],
            )
            collect(target, STATES, message, stamp, stamp + 10_000)
        blocks += target.advance()
    return blocks


def test_lost_messages_end_no_record_and_are_counted():
    """Both messages to the bridge and blocks of telemetry to the monitor are lost."""
    rng, target = np.random.default_rng(0), joint_bridge()
    lost = {*np.flatnonzero(rng.random(2400) < 0.02).tolist(), *range(1000, 1020)} - {0, 2399}
    blocks = send_moves(target, 12.0, lost=lost)
    assert {item.kind for item in target.defects} == {"lost_samples"}
    kept = [block for block in blocks if rng.random() > 0.02 or block in (blocks[0], blocks[-1])]
    assert len(kept) < len(blocks)
    finder = WindowFinder(TriggerSettings(), target.description)
    events = [event for block in kept for event in finder.feed(block)]
    [segment] = [*events, *finder.finish()]
    assert isinstance(segment, Segment)
    assert isinstance(segment.window, Window)
    record = segment.window.telemetry
    assert len(record) > 2300
    measured = sum(len(block) for block in kept)
    assert finder.interpolated_samples == 2400 - measured
    assert np.count_nonzero(record.interpolated) == len(record) - sum(
        len(block) for block in kept if block.first_index >= record.first_index
    )


def test_joint_without_a_command_becomes_telemetry_without_a_command():
    target = joint_bridge()
    blocks = send_moves(target, 6.0)
    assert target.description is not None
    assert not target.description.acquisition.command
    assert not any(block.has_command for block in blocks)
    assert sum(len(block) for block in blocks) == 1200
    assert (target.defects, target.withheld) == ([], 0)


def test_speed_of_an_elastic_joint_is_a_note_and_withholds_nothing():
    target = joint_bridge()
    blocks = send_moves(target, 6.0, speed_factor=0.94)
    assert [item.kind for item in target.defects] == ["speed_ratio"]
    assert sum(len(block) for block in blocks) == 1200


def test_unit_is_judged_again_after_the_first_stroke_before_telemetry_is_withheld():
    """Evidence from one stroke withholds nothing; evidence from three strokes does."""
    target = joint_bridge(learn_s=0.5)
    blocks = send_moves(target, 0.8, speed_factor=57.29578)
    assert [item.kind for item in target.uncertain] == ["speed_unit"]
    assert (target.refused, target.withheld) == ([], 0)
    assert blocks
    send_moves(target, 6.0, begin=160, speed_factor=57.29578)
    assert [item.kind for item in target.refused] == ["speed_unit"]
    assert target.uncertain == []
    assert target.withheld > 0


def test_defect_of_the_first_stroke_disappears_with_more_motion():
    target = joint_bridge(learn_s=0.5)
    send_moves(target, 0.8, speed_factor=-1.0)
    assert [item.kind for item in target.uncertain] == ["speed_sign_reversed"]
    blocks = send_moves(target, 8.0, begin=160)
    assert [item.kind for item in (*target.refused, *target.uncertain)] == []
    assert target.withheld == 0
    assert sum(len(block) for block in blocks) == 8 * 200 - 160


def test_wraps_and_messages_of_zeros_are_bridged_live():
    columns, _ = moves(6.0)
    place = (columns["position"] + 2.0 * np.pi) % (2.0 * np.pi)
    wraps = np.count_nonzero(np.abs(np.diff(place)) > np.pi)
    place[[700, 900]] = 1e37
    target = joint_bridge()
    blocks = send_moves(target, 6.0, position=place)
    position = np.concatenate([block.position for block in blocks])
    assert len(position) == 1200
    assert wraps > 5
    assert (target.losses.wraps, target.losses.impossible) == (wraps, 2)
    assert {item.kind for item in target.defects} == {"angle_wraps", "impossible_samples"}
    assert target.withheld == 0
    moved, true = (values - values[0] for values in (position, columns["position"]))
    np.testing.assert_allclose(moved, true, atol=0.02)


def test_spikes_and_outages_are_handled_live_as_in_files():
    """The spikes are of 8 degrees, and the zeros last 35 ms."""
    true = moves(8.0)[0]["position"] + 0.8
    place = true.copy()
    place[[420, 805, 806, 1300]] += 0.14
    target = joint_bridge()
    blocks = send_moves(target, 8.0, position=place, empty=range(1000, 1007))
    assert (target.losses.impossible, target.losses.lost) == (11, 7)
    assert {item.kind for item in target.defects} == {"impossible_samples", "lost_samples"}
    assert target.withheld == 0
    rows = np.concatenate([block.first_index - 1 + np.arange(len(block)) for block in blocks])
    np.testing.assert_array_equal(rows, np.delete(np.arange(1600), np.arange(1000, 1007)))
    position = np.concatenate([block.position for block in blocks])
    np.testing.assert_allclose(position, true[rows], atol=2e-3)


def test_messages_out_of_order_are_sorted_live():
    order = np.arange(1200)
    for row in range(300, 1100, 90):
        order[[row, row + 1]] = order[[row + 1, row]]
    order[700:704] = [703, 700, 701, 702]
    target = joint_bridge()
    blocks = send_moves(target, 6.0, order=order.tolist())
    np.testing.assert_array_equal(
        np.concatenate([block.position for block in blocks]), moves(6.0)[0]["position"]
    )
    assert target.losses.jumps == target.losses.lost == 0
    assert [item.kind for item in target.defects] == ["samples_reordered"]


@pytest.mark.parametrize("drift", [0.0, 1e-4])
@pytest.mark.parametrize("offset", [0.1, 0.35, 0.8])
def test_two_publishers_of_one_joint_are_an_error(drift, offset):
    """Their samples are not read as one series of twice the rate."""
    _, stamps = moves(10.0)
    period = int(stamps[1] - stamps[0])
    late = stamps + int(offset * period) + (drift * (stamps - stamps[0])).astype(np.int64)
    [defect] = two_publishers(np.sort(np.concatenate([stamps, late])))
    assert defect.is_error
    assert "both at 200 Hz" in defect_text(defect).problem


@pytest.mark.parametrize("offsets", [(0.2, 0.55), (0.1, 0.5, 0.8), (0.15, 0.3, 0.5, 0.9)])
def test_several_publishers_of_one_joint_are_an_error(offsets):
    _, stamps = moves(10.0)
    period = int(stamps[1] - stamps[0])
    each = [stamps + int(offset * period) for offset in (0.0, *offsets)]
    [defect] = two_publishers(np.sort(np.concatenate(each)))
    assert defect.is_error
    assert f"the joint has {len(each)} publishers, each at 200 Hz" in defect_text(defect).problem


def test_jitter_and_lost_samples_are_not_mistaken_for_a_second_publisher():
    _, stamps = moves(10.0)
    period, rng = stamps[1] - stamps[0], np.random.default_rng(1)
    for size in (0.0, 0.05, 0.2):
        noise = np.rint(size * period * rng.standard_normal(len(stamps))).astype(np.int64)
        assert list(two_publishers(np.sort(stamps + noise))) == []
        assert list(two_publishers(np.delete(stamps, rng.integers(0, len(stamps), 300)))) == []


def test_telemetry_of_two_publishers_is_withheld():
    target = joint_bridge(learn_s=0.5)
    send_moves(target, 6.0, publishers_ns=(0, 1_500_000))
    assert "two_publishers" in [item.kind for item in target.refused]
    assert target.withheld > 0


@pytest.mark.parametrize(("before_hz", "after_hz"), [(1000, 100), (100, 500), (500, 250)])
def test_changed_rate_is_learned_again(before_hz, after_hz):
    """No block is published at a rate that differs from the rate of the samples."""
    target = joint_bridge(learn_s=0.5)
    stamp_ns, blocks = START_NS, list[Telemetry]()
    for rate_hz in (before_hz, after_hz):
        columns, stamps = moves(4.0, rate_hz)
        shift_ns = stamp_ns - int(stamps[0])
        for i, stamp in enumerate(stamps + shift_ns):
            stamp_ns = int(stamp)
            at = {name: values[i] for name, values in columns.items()}
            header = SimpleNamespace(
                stamp=SimpleNamespace(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
            )
            message = SimpleNamespace(
                header=header,
                name=["flap"],
                position=[at["position"]],
                velocity=[at["speed"] * JOINT_TAU],
                effort=[at["current"]],
            )
            collect(target, STATES, message, 0, stamp_ns)
            blocks += target.advance() if i % 20 == 0 else []
        stamp_ns += round(1e9 / rate_hz)
    assert target.rate is not None
    assert target.rate.period == pytest.approx(1.0 / after_hz)
    assert target.description is not None
    assert target.description.sample_period == pytest.approx(1.0 / after_hz)
    assert blocks[0].sample_period == pytest.approx(1.0 / before_hz)
    assert blocks[-1].sample_period == pytest.approx(1.0 / after_hz)
    assert blocks[-1].stamp_ns > START_NS + 7 * 10**9
    assert sum(map(len, blocks)) > 3 * before_hz + after_hz


def send_arriving(target: Bridge, rates_hz, seconds, *, burst=1, stall_s=0.0):
    """Send moves without stamps at one rate after another; return blocks with their times.

    Messages arrive late by 0.2 ms on average, in bursts, and after stalls at 1, 3, 5 ... s.
    """
    rng = np.random.default_rng(7)
    start_ns, blocks = START_NS, list[tuple[int, Telemetry]]()
    for rate_hz in rates_hz:
        columns, stamps = moves(seconds, rate_hz)
        sent_ns = stamps - stamps[0] + start_ns
        number = np.arange(len(sent_ns))
        last = np.minimum((number // burst + 1) * burst - 1, number[-1])
        arrivals = sent_ns[last] + np.rint(rng.exponential(2e5, len(number))).astype(np.int64)
        since_s = (1e-9 * (sent_ns - START_NS) + 1.0) % 2.0
        arrivals += np.rint(1e9 * np.clip(stall_s - since_s, 0.0, None)).astype(np.int64)
        for i, arrival_ns in enumerate(np.maximum.accumulate(arrivals).tolist()):
            message = SimpleNamespace(
                header=SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0)),
                name=["flap"],
                position=[columns["position"][i]],
                velocity=[columns["speed"][i] * JOINT_TAU],
                effort=[columns["current"][i]],
            )
            collect(target, STATES, message, 0, arrival_ns)
            if i % 20 == 0:
                blocks += [(arrival_ns, block) for block in target.advance()]
        start_ns = int(sent_ns[-1]) + round(1e9 / rate_hz)
    return blocks


@pytest.mark.parametrize("burst", [1, 8])
@pytest.mark.parametrize(("before_hz", "after_hz"), [(1000, 100), (100, 500), (500, 250)])
def test_changed_rate_is_learned_again_from_arrival_times(before_hz, after_hz, burst):
    """No sample has a stamp after its arrival, and stamps never decrease."""
    target = joint_bridge(mapping(command=None, clock={"source": "arrival"}), learn_s=0.5)
    blocks = send_arriving(target, (before_hz, after_hz), 5.0, burst=burst)
    assert target.rate is not None
    assert target.rate.period == pytest.approx(1.0 / after_hz)
    assert target.description is not None
    assert target.description.sample_period == pytest.approx(1.0 / after_hz)
    assert blocks[0][1].sample_period == pytest.approx(1.0 / before_hz)
    assert blocks[-1][1].sample_period == pytest.approx(1.0 / after_hz)
    assert blocks[-1][1].stamp_ns > START_NS + 9 * 10**9
    assert all(block.stamp_at(len(block)) < arrival_ns for arrival_ns, block in blocks)
    stamps_ns = [block.stamp_ns for _, block in blocks]
    assert stamps_ns == sorted(stamps_ns)
    assert target.rebuilt >= sum(len(block) for _, block in blocks)


@pytest.mark.parametrize("stall_s", [0.15, 0.5])
def test_stalls_of_the_network_are_not_mistaken_for_a_change_of_rate(stall_s):
    target = joint_bridge(mapping(command=None, clock={"source": "arrival"}), learn_s=0.5)
    blocks = send_arriving(target, (500,), 9.0, stall_s=stall_s)
    assert {block.sample_period for _, block in blocks} == {0.002}
    # Only the latest samples wait for their successors.
    assert sum(len(block) for _, block in blocks) > 500 * 9.0 - 300


@pytest.mark.parametrize("kind", ["rate of the mapping", "bursts"])
def test_given_or_uneven_rate_is_not_learned_repeatedly(kind):
    fixed = {"clock": {"rate_hz": 1000.0}} if kind == "rate of the mapping" else {}
    target = joint_bridge(mapping(command=None, **fixed), learn_s=0.5)
    columns, stamps = moves(8.0, 500.0)
    if kind == "bursts":
        number = np.arange(len(stamps))
        stamps = START_NS + number // 16 * 32_000_000 + number % 16 * 500_000
    blocks = []
    for i, stamp in enumerate(stamps):
        time = SimpleNamespace(sec=int(stamp) // 10**9, nanosec=int(stamp) % 10**9)
        message = SimpleNamespace(
            header=SimpleNamespace(stamp=time),
            name=["flap"],
            position=[columns["position"][i]],
            velocity=[columns["speed"][i] * JOINT_TAU],
            effort=[columns["current"][i]],
        )
        collect(target, STATES, message, 0, int(stamp))
        blocks += target.advance() if i % 20 == 0 else []
    assert target.rate is not None
    assert blocks or target.withheld
