"""Slips in the tables' figures and in what the text says of them."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from ema_study.averages import single_fault_runs
from ema_study.case_costs import describes, truth_and_healthy_costs
from ema_study.cases import LEVELS, SINGLE_FAULTS
from ema_study.errata.erratum import Erratum
from ema_study.errata.printed_means import (
    comparisons,
    overviews_with,
    printed_means_that_differ,
    wrong_means,
)
from ema_study.plan import ALGORITHMS, GENERATIONS, POPULATION, VARIANTS
from ema_study.printed_runs import printed_runs
from ema_study.printed_tables import (
    SUM,
    TOTAL,
    ga_trials,
    overview,
    reliability_multiple,
    reliability_single,
)
from ema_study.reliability import (
    PRECISION_STUDY,
    SPEED_STUDY,
    multiple_fault_reliability,
    reliability_of_overviews,
)

_FEWEST_GENERATIONS = 21


def figure_errata() -> Iterator[Erratum]:
    """Yield the slips of chapter 7's tables and of the text about them."""
    runs = printed_runs()
    yield _means()
    yield _mixed_reliability(runs)
    yield _best_for_gain()
    yield _generations(runs)
    yield _times_of_a_generation(runs)
    yield _too_few_generations(runs)
    yield _parallel(runs)
    yield _faster_fitness()
    yield _unequal_stops(runs)
    yield _low_is_not_faster(runs)
    yield _time_of_a_generation(runs)
    yield _ten_runs(runs)
    yield _friction_share(runs)


def _means() -> Erratum:
    differing = printed_means_that_differ()
    total = sum(1 for _ in comparisons())
    counts = ", ".join(
        f"{count} of table {table}"
        for table, count in differing["table"].value_counts().sort_index().items()
    )
    wrong = wrong_means()
    left = sum(one.differs for one in comparisons(overviews_with(wrong)))
    follows = reliability_of_overviews(overview(59), overview(58))
    printed = reliability_single()
    worst = float(np.nanmax(((follows - printed).abs() / printed).to_numpy()))
    return Erratum(
        "Tables 58, 59, 60",
        "; ".join(f"{one.cell}: {one.printed:g} {one.unit}" for one in wrong),
        "; ".join(
            f"{one.recomputed:.4g} {one.unit}, as the runs of table {one.table_of_runs} give"
            for one in wrong
        ),
        f"{len(differing)} of {total} printed means, deviations, products and coefficients do not "
        f"follow from the runs ({counts}). With these {len(wrong)} taken as printed, "
        f"{total - left} follow. Table 60 follows from the printed 58 and 59 to "
        f"{100 * worst:.2f} %.",
    )


def _mixed_reliability(runs: pd.DataFrame) -> Erratum:
    alone = {
        table: multiple_fault_reliability(runs, table, table)["RC"].dropna()
        for table in (SPEED_STUDY, PRECISION_STUDY)
    }
    printed = reliability_multiple()["RC"].dropna()
    text = "; ".join(
        f"table {table} alone: "
        + ", ".join(f"{name.upper()} {coefficients[name]:.1f}" for name in ALGORITHMS)
        for table, coefficients in alone.items()
    )
    best = {table: str(rc.idxmax()).upper() for table, rc in alone.items()}
    return Erratum(
        "Table 61",
        f"{str(printed.idxmax()).upper()} is best, with {printed.max():.1f} %",
        "it multiplies the times of one study by the errors of another: no run had both",
        f"{text}. Best: {best[SPEED_STUDY]} for speed, {best[PRECISION_STUDY]} for precision.",
    )


def _best_for_gain() -> Erratum:
    table = reliability_single().drop(index=SUM)
    best = ", ".join(
        f"{fault.replace('_', ' ')} {str(table[fault, 'RC'].idxmax()).upper()}"
        for fault in (*SINGLE_FAULTS, TOTAL)
    )
    gain = table["gain", "RC"]
    return Erratum(
        "Chapter 8",
        "PSO has the best reliability for friction, eccentricity and gain",
        f"for gain {str(gain.idxmax()).upper()} has",
        f"table 60: {gain.max():.2f} against {gain['pso']:.2f} % for PSO; best by fault: {best}.",
    )


def _generations(runs: pd.DataFrame) -> Erratum:
    run = runs[runs["generations"] > GENERATIONS].iloc[0]
    others = runs[(runs["table"] == run["table"]) & (runs["run"] != run["run"])]
    pace = float((others["time_s"] / others["generations"]).median())
    by_time = run["time_s"] / pace
    digits = str(run["generations"])
    shorter = {int(digits[:place] + digits[place + 1 :]) for place in range(len(digits))}
    meant = min(shorter, key=lambda number: abs(number - by_time))
    return Erratum(
        f"Table {run['table']}, run {run['run']}",
        f"{digits} generations",
        f"by its time {by_time:.1f}: probably {meant}, with a digit too many",
        f"{GENERATIONS} is the limit; the other runs took {pace:.2f} s a generation, "
        f"this one {run['time_s']} s.",
    )


def _times_of_a_generation(runs: pd.DataFrame) -> Erratum:
    pso = runs[runs["algorithm"] == "pso"]
    pso = pso.assign(pace=pso["time_s"] / pso["generations"])
    of_table = pso[pso["table"] == 39]
    usual = float(pso.loc[pso["table"].between(11, 54), "pace"].median())
    slow = int((of_table["pace"] > 1.3 * usual).sum())
    slowest = of_table.nlargest(1, "pace").iloc[0]
    return Erratum(
        "Table 39",
        "times and generations of its runs",
        "they do not belong together",
        f"{slow} of {len(of_table)} runs took more than 1.3 times PSO's usual {usual:.1f} s a "
        f"generation, up to {slowest['pace']:.1f} s: run {slowest['run']} took "
        f"{slowest['time_s']} s for {slowest['generations']} generations, what "
        f"{slowest['time_s'] / usual:.0f} usually take.",
    )


def _too_few_generations(runs: pd.DataFrame) -> Erratum:
    own = runs[runs["table"].between(11, 54) & runs["algorithm"].isin(list(VARIANTS))]
    early = own[own["generations"] < _FEWEST_GENERATIONS]
    text = ", ".join(
        f"table {row['table']} run {row['run']}: {row['generations']}"
        for row in early.to_dict("records")
    )
    return Erratum(
        "Section 7.1 (stop rule)",
        "DE and GWO stop after more than 20 generations",
        "not all runs kept to it",
        f"{len(early)} of {len(own)} runs of DE and GWO have fewer than {_FEWEST_GENERATIONS} "
        f"generations ({text}).",
    )


def _parallel(runs: pd.DataFrame) -> Erratum:
    before, after = (runs[runs["table"] == table]["time_s"].mean() for table in (9, 10))
    trials = ga_trials()["time_s"]
    return Erratum(
        "Section 7.1, tables 9, 10",
        "F = 0.9, CR = 0.95 is better than F = 0.5, CR = 0.9 in error and in time",
        "in error; of the time it contradicts itself: two sentences later it says that the time "
        "fell because of the parallel execution that came between",
        "neither table has a stop rule, so both do the same number of evaluations; the times are "
        f"{before / after:.2f} to 1, and {trials[8] / trials[10]:.2f} to 1 for GA between trials 8 "
        "and 10 of table 8, which differ in nothing but that.",
    )


def _faster_fitness() -> Erratum:
    trials = ga_trials().loc[[6, 7]]
    rates = 60.0 * trials["generations"] / trials["time_s"]
    speeds = trials["population"] * trials["generations"] / trials["time_s"]
    return Erratum(
        "Section 7.1, table 8",
        "a leaner fitness function raised the speed from 1.15 to 5.74 generations a minute",
        "the population fell from 100 to 20 at the same time; the speed did not change",
        f"trials 6 and 7: {rates[6]:.2f} and {rates[7]:.2f} generations a minute, but "
        f"{speeds[6]:.2f} and {speeds[7]:.2f} evaluations a second.",
    )


def _unequal_stops(runs: pd.DataFrame) -> Erratum:
    de = runs[runs["table"].isin([10, 13])].groupby("table")[["error_percent", "time_s"]].mean()
    return Erratum(
        "Section 7.3, tables 58 to 60",
        "DE and GWO are fast, PSO and GA precise",
        "the tables compare stop rules as much as algorithms: only DE and GWO stop at a cost",
        "DE on low friction, the same in all but the stop: "
        f"{de.loc[10, 'error_percent']:.2f} % in {de.loc[10, 'time_s']:.0f} s without (table 10), "
        f"{de.loc[13, 'error_percent']:.2f} % in {de.loc[13, 'time_s']:.0f} s with (table 13).",
    )


def _low_is_not_faster(runs: pd.DataFrame) -> Erratum:
    own = single_fault_runs(runs)
    own = own[own["algorithm"].isin(list(VARIANTS))]
    cases = [own["fault"], own["level"]]
    sizes = own.groupby(cases).size()
    stopped = (own["generations"] < GENERATIONS).groupby(cases).sum()
    medians = own["generations"].groupby(cases).median()
    never = [fault for fault in SINGLE_FAULTS if stopped[fault, "high"] == 0]
    counts = ", ".join(
        f"{fault} {stopped[fault, 'low']} and {stopped[fault, 'high']} of {sizes[fault, 'high']}"
        for fault in never
    )
    generations = ", ".join(
        f"{fault.replace('_', ' ')} {medians[fault, 'low']:g} and {medians[fault, 'high']:g}"
        for fault in SINGLE_FAULTS
        if fault not in never
    )
    costs = {
        fault: [truth_and_healthy_costs("thesis", f"{fault} {level}")[0] for level in LEVELS]
        for fault in never
        if all(describes("thesis", f"{fault} {level}") for level in LEVELS)
    }
    fits = ", ".join(
        f"of {fault} cost {low:.4f} and {high:.4f}" for fault, (low, high) in costs.items()
    )
    return Erratum(
        "Sections 7.1, 7.2.1 (low and high)",
        "a high fault takes longer because the search has further to go",
        f"the level makes a large difference in {' and '.join(never)} only, where DE and GWO never "
        "come below the threshold when it is high",
        f"runs of DE and GWO, low and high, that stopped before {GENERATIONS} generations: "
        f"{counts}. In the other faults both levels stop; median generations, low and high: "
        f"{generations}. With the thesis's model the true faults {fits} A^2.s, low and high: it "
        "fits the high one worse. Of what eq. 4.24 does not describe nothing can be said.",
    )


def _time_of_a_generation(runs: pd.DataFrame) -> Erratum:
    of_table = runs[runs["table"] == SPEED_STUDY]
    means = of_table.groupby("algorithm")[["time_s", "generations", "evaluations"]].mean()
    as_counted = means["time_s"] / means["generations"]
    with_start = POPULATION * means["time_s"] / means["evaluations"]
    uncounted = means["evaluations"] > POPULATION * means["generations"]
    text = "; ".join(
        f"{name.upper()} {as_counted[name]:.1f} and {with_start[name]:.1f} s"
        for name in means.index[uncounted]
    )
    rest = ", ".join(
        f"{name.upper()}'s are {as_counted[name]:.1f} s" for name in means.index[~uncounted]
    )
    return Erratum(
        "Section 7.3 (time of a generation)",
        "PSO's generations are the slowest, 17 s, GA's and DE's the fastest, 14 s",
        f"{', '.join(name.upper() for name in means.index[uncounted])} evaluate their starting "
        "population without counting it; in a handful of generations it matters",
        f"table 56, mean time by generations, without and with the starting one: {text}. {rest} as "
        "printed: appendix B evaluates the start within the first generation.",
    )


def _ten_runs(runs: pd.DataFrame) -> Erratum:
    times = runs[runs["table"] == 40]["time_s"]
    return Erratum(
        "Section 7.2.4",
        "DE takes about 400 s for ten optimizations of the low fault",
        "for one",
        f"table 40: mean {times.mean():.0f} s, all ten {times.sum():.0f} s.",
    )


def _friction_share(runs: pd.DataFrame) -> Erratum:
    de = runs[(runs["table"] == PRECISION_STUDY) & (runs["algorithm"] == "de")]
    off = (de["k1"] - de["true_k1"]).mean()
    return Erratum(
        "Section 7.3 (table 57)",
        "DE finds the small friction fault to 0.07 %",
        "0.07 % of the range; of the fault it is far more",
        f"mean k1 {de['k1'].mean():.5f} for {de['true_k1'].iloc[0]:g}: off by {100 * off:.3f} % of "
        f"the range, {100 * off / de['true_k1'].iloc[0]:.0f} % of the fault.",
    )
