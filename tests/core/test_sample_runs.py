# SPDX-License-Identifier: Apache-2.0
"""Losses of telemetry are counted for each publisher, and several publishers are detected."""

import pytest

from ema_core.sample_runs import SampleRuns, several_publishers


def received(runs: SampleRuns, now_s: float, *indices: int) -> None:
    """Add blocks of ten samples with the given first indices."""
    for first_index in indices:
        runs.add(first_index, 10, now_s)


@pytest.mark.parametrize(
    ("indices", "blocks", "samples", "several"),
    [
        ((500, 510, 540, 550), 2, 20, False),
        ((7, 17, 32), 1, 5, False),  # Half a block counts as one.
        ((500, 510, 0, 10), 0, 0, False),  # The publisher restarts.
        ((500, 510, 540, 570), 2 + 2, 40, False),
        ((500, 90_000, 510, 520, 530), 0, 0, False),  # a single wrong index
        ((500, 510, 510, 520, 530), 0, 0, False),  # a repeated block
        # Two publishers; the second starts later, and each has its own gaps.
        ((500, 90_000, 510, 90_010, 520), 0, 0, True),
        ((500, 500, 510, 510, 520, 520, 530, 530), 0, 0, True),
        ((500, 90_000, 510, 90_010, 540, 90_050, 550, 90_060), 2 + 3, 50, True),
        ((90_000, 0, 10, 90_010, 20, 20_000, 20_010, 90_020, 20_020), 1997, 19_970, True),
    ],
)
def test_losses_count_per_publisher_once_the_earlier_run_has_ended(
    indices: tuple[int, ...], blocks: int, samples: int, several: bool
):
    runs = SampleRuns()
    received(runs, 100.0, *indices)
    runs.settle(100.0)
    assert runs.lost_samples == 0  # The earlier publisher may still continue.
    assert runs.are_several == several
    received(runs, 106.0, indices[-1] + 10)
    runs.settle(106.0)
    runs.settle(107.0)
    assert (runs.lost_blocks, runs.lost_samples) == (blocks, samples)
    assert not runs.are_several  # The only publisher has continued.


def test_unfinished_runs_are_dropped():
    runs = SampleRuns()
    received(runs, 100.0, *range(0, 100_000, 100))
    assert len(runs._runs) == 100
    runs.settle(106.0)
    assert runs.lost_blocks == 9 * 99


def test_warning_names_some_of_the_nodes():
    names = {f"/n{number}" for number in range(7)}
    assert several_publishers(["flap"], names) == (
        "several publishers send actuator_id flap (/n0, /n1, /n2, /n3, /n4, and 2 more): stop all "
        "but one"
    )
