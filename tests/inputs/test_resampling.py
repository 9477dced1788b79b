# SPDX-License-Identifier: Apache-2.0
"""Samples at a fixed period from stamps with jitter, jumps, delays or losses."""

from itertools import pairwise

import numpy as np
import pytest

from ema_bags.inputs.arrival import ArrivalClock
from ema_bags.inputs.rate import find_rate
from ema_bags.inputs.resampling import Resampler

H_NS = 1_000_000
START_NS = 1_700_000_000_000_000_000


def regular(n: int, period_ns: float = H_NS) -> np.ndarray:
    return START_NS + np.rint(np.arange(n) * period_ns).astype(np.int64)


def resampled(stamps, values=None, **more):
    rate = find_rate(stamps, **more)
    resampler = Resampler(rate)
    numbers = np.arange(len(stamps), dtype=float) if values is None else values
    return resampler.push(stamps, numbers[:, None]), resampler.losses, rate


@pytest.mark.parametrize(
    ("rate_hz", "true_hz"),
    [(1000.0, 1000.0), (1000.0, 1000.07), (500.0, 499.9), (400.0, 400.0), (8000.0, 8000.0)],
)
def test_rate_is_the_nearest_common_one(rate_hz, true_hz):
    assert 1.0 / find_rate(regular(3000, 1e9 / true_hz)).period == rate_hz


def test_uncommon_rate_is_kept():
    # It differs from 1000 Hz by 0.3 %, and from any whole number of hertz by more than the stamps
    # could be wrong.
    assert find_rate(regular(3000, 1e9 / 7.37)).period == pytest.approx(1 / 7.37, rel=1e-6)


def test_rate_is_measured_despite_losses_jitter_and_coarse_stamps():
    rng = np.random.default_rng(0)
    stamps = regular(5000, 2.5e6)
    kept = stamps[np.sort(rng.choice(5000, 4700, replace=False))]
    coarse = kept // 1_000_000 * 1_000_000
    noisy = kept + np.rint(rng.normal(0.0, 2e5, len(kept))).astype(np.int64)
    for jittered in (kept, coarse, noisy):
        assert 1.0 / find_rate(jittered).period == 400.0


def test_regular_samples_stay_bit_identical():
    values = np.random.default_rng(1).normal(size=2000)
    stamps = regular(2000)
    [run], losses, _ = resampled(stamps, values)
    assert np.array_equal(run.values[:, 0], values)
    assert np.array_equal(run.stamps_ns, stamps)
    assert (run.first_index, losses.lost) == (1, 0)


def test_clock_drift_makes_no_gap():
    # A drift of 70 parts per million is one sample in 14 s if the nominal period determined the
    # indices.
    [run], losses, _ = resampled(regular(60_000, 1e6 * (1 + 7e-5)))
    assert (len(run.values), losses.lost) == (60_000, 0)


def test_jittered_samples_are_interpolated_at_their_stamps():
    rng = np.random.default_rng(2)
    stamps = regular(4000) + np.rint(rng.uniform(-2e5, 2e5, 4000)).astype(np.int64)
    seconds = (stamps - START_NS) * 1e-9
    runs, losses, rate = resampled(stamps, np.sin(2 * np.pi * 5.0 * seconds))
    [run] = runs
    assert not rate.is_regular
    assert losses.lost == 0
    expected = np.sin(2 * np.pi * 5.0 * (run.stamps_ns - START_NS) * 1e-9)
    # Linear interpolation between points 1.4 ms apart deviates from the sine by (w h)^2 / 8.
    assert np.max(np.abs(run.values[:, 0] - expected)) < (2 * np.pi * 5.0 * 1.4e-3) ** 2 / 8
    assert np.all(np.abs(np.diff(run.stamps_ns) - H_NS) <= 1)


@pytest.mark.parametrize("jitter_ns", [0.0, 1e5])
def test_losses_leave_a_gap_of_their_size(jitter_ns):
    rng = np.random.default_rng(3)
    keep = np.ones(3000, bool)
    keep[1000] = keep[2000:2007] = False
    moved = regular(3000) + np.rint(rng.uniform(-jitter_ns, jitter_ns, 3000)).astype(np.int64)
    runs, losses, _ = resampled(moved[keep])
    assert (losses.lost, losses.gaps) == (8, 2)
    assert len(runs) == 3
    for before, after in pairwise(runs):
        end = before.first_index + len(before.values)
        elapsed = (after.stamps_ns[0] - before.stamps_ns[-1]) / H_NS
        assert after.first_index - end == round(elapsed) - 1 >= 1


@pytest.mark.parametrize("jitter_ns", [0.0, 1e5])
@pytest.mark.parametrize("part", [3000, 7, 1])
def test_short_losses_are_filled_but_not_across_a_reversal(jitter_ns, part):
    rng = np.random.default_rng(6)
    keep = np.ones(3000, bool)
    keep[510] = keep[999:1001] = keep[2300:2303] = keep[2500:2504] = False
    stamps = regular(3000) + np.rint(rng.uniform(-jitter_ns, jitter_ns, 3000)).astype(np.int64)
    seconds = (stamps - START_NS) * 1e-9
    # The motion reverses at 1 s and rests from 2 s on.
    position = np.interp(seconds, [0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    values = np.column_stack([np.arange(3000.0), position + rng.normal(0.0, 1e-6, 3000)])[keep]
    kept = stamps[keep]
    resampler = Resampler(find_rate(kept), 3, (1,))
    runs = []
    for start in range(0, len(kept), part):
        runs += resampler.push(kept[start : start + part], values[start : start + part])
    losses = resampler.losses
    assert (losses.filled, losses.lost, losses.gaps) == (4, 6, 2)
    for run in runs:
        assert np.interp(run.stamps_ns, stamps, np.arange(3000.0)) == pytest.approx(
            run.values[:, 0], abs=1e-3 + jitter_ns / H_NS
        )
    ends = [after.first_index - len(b.values) - b.first_index for b, after in pairwise(runs)]
    assert [number for number in ends if number] == pytest.approx([2, 4], abs=bool(jitter_ns))


def test_pause_is_not_filled_and_the_last_sample_is_kept():
    stamps = regular(60, 2e8)
    stamps = np.concatenate(
        [stamps[:30], stamps[38:58], stamps[59:]]
    )  # 1.8 s, and the last but one
    resampler = Resampler(find_rate(stamps), 10, (0,))
    runs = resampler.push(stamps, np.arange(len(stamps), dtype=float)[:, None], is_last=True)
    losses = resampler.losses
    assert (losses.filled, losses.pauses, losses.gaps) == (0, 1, 1)
    assert sum(len(run.values) for run in runs) == len(stamps)


@pytest.mark.parametrize("jitter_ns", [0.0, 1e5])
def test_clock_that_goes_back_ends_a_run(jitter_ns):
    rng = np.random.default_rng(4)
    stamps = regular(3000) + np.rint(rng.uniform(-jitter_ns, jitter_ns, 3000)).astype(np.int64)
    stamps[1500:] -= 700 * H_NS
    runs, losses, _ = resampled(stamps)
    assert (losses.jumps, losses.lost, len(runs)) == (1, 0, 2)
    assert runs[1].first_index > runs[0].first_index + len(runs[0].values)


def test_pause_is_not_a_loss():
    stamps = regular(2000)
    stamps[1000:] += 5_000_000_000
    runs, losses, _ = resampled(stamps)
    assert (losses.lost, losses.pauses, len(runs)) == (0, 1, 2)


def test_repeated_and_non_finite_samples_are_left_out_and_counted():
    stamps = np.sort(np.concatenate([regular(1000), regular(1000)[10:20]]))
    values = np.arange(1010.0)
    values[500:503] = np.nan
    runs, losses, _ = resampled(stamps, values)
    assert (losses.repeated, losses.missing, losses.lost) == (10, 3, 3)
    assert sum(len(run.values) for run in runs) == 997


def delays(n: int, seed: int) -> np.ndarray:
    """Return delays of arrival [ns]: 0.2 ms, an exponential tail of 0.1 ms, and stalled queues."""
    rng = np.random.default_rng(seed)
    late = 2e5 + rng.exponential(1e5, n)
    for start in range(400, n - 100, 997):
        # Nothing arrives for 20 ms, and then everything at the same time.
        late[start : start + 20] += np.arange(20, 0, -1) * 1e6
    return np.rint(late).astype(np.int64)


def test_stamps_are_rebuilt_from_arrival_times():
    stamps = regular(10_000)
    clock = ArrivalClock(1e-3)
    rebuilt = np.concatenate([clock.push(stamps + delays(10_000, 5)), clock.flush()])
    assert len(rebuilt) == clock.rebuilt == 10_000
    error = rebuilt - stamps
    # A common constant delay, without jitter: after the first second, which the fitted line needs,
    # the scatter is far below the 0.1 ms of the delays.
    assert np.std(error[1000:]) < 1e4
    assert np.all(np.abs(np.diff(rebuilt) / H_NS - 1.0) < 0.1)


def rebuilt(arrivals: np.ndarray, parts: int, period: float = 1e-3) -> np.ndarray:
    """Return the rebuilt stamps [ns] of messages that arrive in a number of parts."""
    clock = ArrivalClock(period)
    stamps = [clock.push(part) for part in np.array_split(arrivals, parts)]
    return np.concatenate([*stamps, clock.flush()])


def test_losses_are_detected_in_arrival_times_and_queues_are_not_losses():
    keep = np.ones(10_000, bool)
    keep[3000] = keep[6000:6030] = False
    arrivals = (regular(10_000) + delays(10_000, 6))[keep]
    _, losses, _ = resampled(rebuilt(arrivals, 700))
    assert (losses.lost, losses.gaps) == (31, 2)


@pytest.mark.parametrize("rate_hz", [100, 1000])
@pytest.mark.parametrize("seed", [0, 3, 5])
def test_samples_late_by_up_to_0_14_s_are_counted_and_none_is_lost(rate_hz, seed):
    rng = np.random.default_rng(seed)
    times = np.arange(20 * rate_hz) / rate_hz
    arrivals = times + rng.exponential(1e-4, len(times))
    # The publisher stalls now and then, also at its start, and then sends the waiting samples.
    start = 5 / rate_hz
    while start < times[-1] - 1.0:
        end = start + rng.uniform(0.3, 1.0) * 0.14
        waits = (times >= start) & (times < end)
        arrivals[waits] = np.maximum(arrivals[waits], end)
        start += rng.uniform(0.2, 2.0)
    arrivals = START_NS + np.rint(1e9 * np.maximum.accumulate(arrivals)).astype(np.int64)
    stamps = rebuilt(arrivals, len(arrivals) // 5, 1.0 / rate_hz)
    assert set(np.rint(np.diff(stamps) * 1e-9 * rate_hz)) == {1.0}


@pytest.mark.parametrize("lost", [3, 100, 300])
def test_loss_soon_after_a_long_stall_is_counted(lost):
    keep, arrivals = np.ones(20_000, bool), regular(20_000)
    # Nothing arrives for 0.4 s, then everything that waited; 2 s later, samples are lost.
    arrivals[8000:8400] = arrivals[8400]
    keep[10_400 : 10_400 + lost] = False
    _, losses, _ = resampled(rebuilt(arrivals[keep], 4000))
    assert (losses.lost, losses.gaps) == (lost, 1)


def test_stamps_do_not_depend_on_the_parts_in_which_messages_arrive():
    arrivals = regular(5000) + delays(5000, 7)
    at_once, gradually = rebuilt(arrivals, 1), rebuilt(arrivals, 5000)
    # Different later samples are known, but the fitted line is the same.
    assert np.std((at_once - gradually)[1000:]) < 1e4


def test_stamps_that_never_increase_are_refused():
    with pytest.raises(ValueError, match="expected increasing stamps"):
        find_rate(np.full(10, START_NS))
