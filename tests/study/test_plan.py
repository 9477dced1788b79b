# SPDX-License-Identifier: Apache-2.0
"""The plan of the study, compared with the thesis's own runs."""

from ema_monitor.optimizers import ALGORITHMS
from ema_study.plan import plan


def test_table_8_has_its_trials_of_ga_only():
    trials = [job for job in plan("fast", 1) if job.table == 8]
    assert {job.algorithm for job in trials} == {"ga"}
    assert [job.run for job in trials] == list(range(2, 13))
    last = trials[-1]
    assert (last.case, last.population, last.max_generations) == ("gain low", 50, 200)
    assert not [job for job in plan("fast", 1, with_trials=False) if job.table == 8]


def test_jobs_have_distinct_keys_and_registered_algorithms():
    jobs = plan("fast", 10)
    assert len(jobs) == 761
    assert len({job.key for job in jobs}) == len(jobs)
    assert {job.algorithm for job in jobs} <= set(ALGORITHMS)


def test_budget_includes_the_initial_population_which_only_gwo_counts_as_a_generation():
    """Appendix B evaluates the first pack within the first iteration, appendix A before it."""
    budgets = {job.algorithm: job.budget for job in plan("fast", 1) if job.table in (12, 13, 14)}
    assert budgets == {
        "pso": 50 * 201,
        "de": 50 * 201,
        "de_thesis": 50 * 201,
        "gwo": 50 * 200,
        "gwo_thesis": 50 * 200,
    }
