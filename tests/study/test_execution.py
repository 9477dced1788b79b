# SPDX-License-Identifier: Apache-2.0
"""Runs of the study on executors."""

import pytest

from ema_core.tasks import Workers
from ema_study.execution import execute, time_executors
from ema_study.plan import Job

JOBS = [
    Job("fast", 10, "de", "friction low", "low", run, "all_generations", 8, 2) for run in (1, 2, 3)
]


def results(done):
    return {result.job.run: result.estimate for result in done}


@pytest.fixture(scope="module")
def serial():
    with Workers("threads", 1) as workers:
        return results(execute(JOBS, workers))


@pytest.mark.long
def test_processes_give_the_same_results_as_a_single_one(serial):
    with Workers("processes", 2) as workers:
        assert results(execute(JOBS, workers)) == serial


@pytest.mark.long
def test_timing_compares_each_mode_with_one_core():
    frame = time_executors("fast", workers=2)
    assert frame["how"].str.contains("one core|all cores|processes").tolist() == [True] * 3
    assert frame["workers"].tolist() == [1, 1, 2]
    assert (frame["seconds"] > 0.0).all()
    assert frame["speedup"].to_numpy() == pytest.approx(frame["seconds"][0] / frame["seconds"])
