# SPDX-License-Identifier: Apache-2.0
"""Samples slightly out of order, and interleaved stamps of two publishers with different rates."""

import numpy as np
import pytest

from ema_bags.inputs.defect_kinds import DefectKind
from ema_bags.inputs.defect_wording import defect_text
from ema_bags.inputs.importing import import_series
from ema_bags.inputs.ordering import settled_samples, sorting_order
from ema_bags.inputs.publishers import two_publishers
from ema_bags.inputs.series import Series

from .joint_motion import joint, moves


def imported(mapping, columns, stamps, rate_hz=200.0):
    return import_series({"": Series(stamps, stamps, columns)}, mapping, joint(rate_hz))


@pytest.mark.parametrize("rate_hz", [50.0, 500.0])
@pytest.mark.parametrize("late", [1, 3])
def test_samples_slightly_out_of_order_are_sorted(mapped, rate_hz, late):
    columns, stamps = moves(rate_hz=rate_hz)
    order = np.arange(len(stamps))
    for row in range(40, len(stamps) - 40, 83):
        order[row : row + late + 1] = np.roll(order[row : row + late + 1], -1)
    shuffled = {name: values[order] for name, values in columns.items()}
    got = imported(mapped(), shuffled, stamps[order], rate_hz)
    [defect] = got.defects
    assert (defect.kind, defect.is_error) == ("samples_reordered", False)
    assert got.stream.losses.reordered == np.count_nonzero(order != np.arange(len(order)))
    [run] = got.runs
    position = run.values[:, got.stream.filled.index("position")]
    np.testing.assert_array_equal(position, columns["position"])


def test_clock_that_goes_back_far_is_not_sorted():
    _, stamps = moves()
    assert sorting_order(stamps) is None
    assert sorting_order(np.concatenate([stamps[:1200], stamps[1200:] - 6_000_000_000])) is None
    assert sorting_order(np.concatenate([stamps[1200:], stamps[:1200]])) is None
    assert sorting_order(stamps[::-1]) is None


def test_sample_that_is_missing_among_the_last_may_still_arrive():
    period = 5_000_000
    stamps = period * np.array([0, 1, 2, 4, 5])
    assert settled_samples(stamps, None, period) == 3
    assert settled_samples(stamps[3:], 2 * period, period) == 0
    assert settled_samples(period * np.array([0, 1, 2, 4, 5, 6, 7, 8]), None, period) == 8
    assert settled_samples(stamps[:3], -period, period) == 3


@pytest.mark.parametrize("times", [2, 3])
@pytest.mark.parametrize("offset", [0.15, 0.4, 0.8])
def test_second_publisher_at_a_fraction_of_the_rate_is_an_error(mapped, times, offset):
    columns, stamps = moves(rate_hz=500.0)
    rows = np.arange(0, len(stamps), times)
    both = np.concatenate([stamps, stamps[rows] + round(offset * 2_000_000)])
    order = np.argsort(both, kind="stable")
    source = np.concatenate([np.arange(len(stamps)), rows])[order]
    doubled = {name: values[source] for name, values in columns.items()}
    got = imported(mapped(), doubled, both[order], 500.0)
    [defect] = [item for item in got.defects if item.kind == "two_publishers"]
    assert defect.is_error
    assert f"one at 500 Hz, the other at {500 / times:.4g} Hz" in defect_text(defect).problem


@pytest.mark.parametrize("rate_hz", [300.0, 400.0, 700.0])
def test_rate_that_is_not_a_divisor_of_1_khz_is_not_mistaken_for_a_second_publisher(rate_hz):
    stamps = 1_000_000 * np.rint(1e3 / rate_hz * np.arange(4000)).astype(np.int64)
    assert list(two_publishers(stamps)) == []


def test_second_publisher_that_repeats_the_values_is_a_note_with_both_rates(mapped):
    columns, stamps = moves(rate_hz=250.0)
    rng = np.random.default_rng(2)
    late = stamps + 1_400_000 + rng.integers(-60_000, 60_000, len(stamps))
    doubled = {name: np.repeat(values, 2) for name, values in columns.items()}
    got = imported(mapped(), doubled, np.column_stack([stamps, late]).ravel(), 250.0)
    by_kind = {item.kind: item for item in got.defects}
    assert {kind: item.is_error for kind, item in by_kind.items()} == {
        "values_repeat": False,
        "two_publishers": False,
    }
    assert (
        "published 2 times: updated at 250 Hz, published at 500 Hz"
        in defect_text(by_kind[DefectKind.VALUES_REPEAT]).problem
    )
    [run] = got.runs
    position = run.values[:, got.stream.filled.index("position")]
    np.testing.assert_array_equal(position, columns["position"])
