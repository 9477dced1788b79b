"""The figures of own_laws.py as tables, and its targets."""

from collections.abc import Mapping
from typing import Any, Final

from rich import box
from rich.console import Console
from rich.table import Table
from tables import target_table
from targets import Row, untargeted

from prognosis.scores import JUDGED_LAMBDA, LAMBDAS, WITHOUT_DIFFUSION

TARGETS: Final = {"law known": (0.90, 0.95), "law unknown": (0.80, 0.85)}
"""Least cumulative relative accuracy and least pass rate of alpha-lambda [-]."""

BESIDE: Final = "oracle / progpy"
"""Whose figures stand beside ours: an accuracy that the oracle misses nobody can reach."""

LOWEST_COVERAGE: Final = 0.85
HIGHEST_COVERAGE: Final = 0.95
LONGEST_S: Final = 0.02

_TITLES: Final = {
    "drawn": "drawn estimates",
    "real": "estimator in the loop",
    "repaired": "drawn estimates, from a repair on",
    "otherwise": "drawn estimates, by other laws",
}
_TARGETED: Final = ("drawn", "real")


def rows(figures: Mapping[str, Any]) -> list[Row]:
    """Return what was measured with its targets.

    Parameters
    ----------
    figures
        What ``own_laws.measure`` returns.
    """
    result = []
    for case in _TITLES:
        for name in TARGETS:
            if name in figures.get(case, ()):
                result += _accuracy_rows(figures[case], case, name)
    for name, one in figures.get("whole", {}).items():
        lives, failing = one["lives"], one["by_requirement"]
        result += [
            untargeted(
                f"{lives} lives, {failing} ended by a requirement, {name}: accuracy",
                f"{one['cra']:.3f}",
            ),
            untargeted(
                "  coverage of the 90 % interval, share that lies wholly beyond the truth",
                f"{one['coverage']:.3f}, {one['too_long']:.3f}",
            ),
        ]
    for name in TARGETS:
        result += _constant_rows(figures["constant"][name], name)
    return [*result, *_time_rows(figures)]


def _accuracy_rows(by_method: Mapping[str, Any], case: str, name: str) -> list[Row]:
    least, rate = TARGETS[name]
    rate_at = f"{JUDGED_LAMBDA:g}"

    def row(what: str, kind: str, key: str, lowest: float, highest: float = 1.0) -> Row:
        values = {
            method: of_it[kind][key][rate_at] if key == "alpha_lambda" else of_it[kind][key]
            for method, of_it in by_method.items()
        }
        beside = " / ".join(
            f"{values[method]:.3f}" if method in values else "-" for method in ("oracle", "progpy")
        )
        measured, has_target = values[name], kind == "all" and case in _TARGETED
        target = f">= {lowest:.2f}" if highest == 1.0 else f"{lowest:.2f} to {highest:.2f}"
        met = lowest <= measured <= highest if has_target else None
        return Row(what, target if has_target else "", f"{measured:.3f}", met, beside)

    lives = f"{by_method[name]['all']['lives']} lives, {_TITLES[case]}, {name}"
    passing = f"alpha-lambda (20 %) at {JUDGED_LAMBDA:g}, pass rate"
    without = f"  {WITHOUT_DIFFUSION}: cumulative relative accuracy"
    bounds = (LOWEST_COVERAGE, HIGHEST_COVERAGE)
    return [
        row(f"{lives}: cumulative relative accuracy", "all", "cra", least),
        row(f"  {passing}", "all", "alpha_lambda", rate),
        row(without, WITHOUT_DIFFUSION, "cra", least),
        row(f"    {passing}", WITHOUT_DIFFUSION, "alpha_lambda", rate),
        row("  coverage of the 90 % interval", "all", "coverage", *bounds),
    ]


def _constant_rows(one: Mapping[str, Any], name: str) -> list[Row]:
    reported = one["reported"]
    what = f"{one['lives']} lives of constant faults, {name}: with a remaining life reported"
    return [
        Row(what, "0", str(reported), reported == 0),
        untargeted(
            "  by a fault limit, by a requirement, by one wrongly said to fail",
            f"{one['by_faults']}, {one['by_requirements']}, {one['wrongly_reported_failing']}",
        ),
        untargeted(
            "  so faulty that a requirement fails from the first test on: so reported",
            f"{one['rightly_reported_failing']} of {one['failing']}",
        ),
    ]


def _time_rows(figures: Mapping[str, Any]) -> list[Row]:
    by_method, whole = figures["drawn"], figures["whole_update"]
    spent = {
        f"update by fault limits, {name}": by_method[name]["all"]["seconds"] for name in TARGETS
    }
    what = f"  with requirements and health, law unknown, {whole['lives']} lives"
    spent[what] = whole["median_s"]
    target = f"<= {1e3 * LONGEST_S:g}"
    result = [
        Row(f"{what}, processor time, median [ms]", target, f"{1e3 * one:.1f}", one <= LONGEST_S)
        for what, one in spent.items()
    ]
    late = f"{1e3 * whole['p95_s']:.1f}, {1e3 * whole['first_median_s']:.0f}"
    progpy = f"{1e3 * by_method['progpy']['all']['seconds']:.0f}"
    return [
        *result,
        untargeted("  95th percentile, first test of a unit [ms]", late),
        untargeted("  update of progpy, median [ms]", progpy),
    ]


def show(console: Console, figures: Mapping[str, Any]) -> None:
    """Print the tables."""
    for case, title in _TITLES.items():
        if case in figures:
            console.print(score_table(title, figures[case]))
    console.print(
        "CRA: mean over lives and the tests in their second half of 1 - |r* - r| / r*, r the "
        "median of the remaining useful life and r* the truth; no prediction counts 0. On event "
        "time, for comparison: the same by 1 - |r* - r| / EoL. a-l: lives in which at least half "
        "of the probability is within 20 % of r* at that share of the time from the first "
        "prediction to the end. covers: 90 % intervals that hold the truth. horizon, convergence, "
        "first prediction, time: medians over lives; of the whole life, of the time from first "
        "prediction to end, of the whole life, processor time a test.\n"
    )
    constant = figures["constant"]["linear trend"]
    console.print(
        f"{constant['lives']} lives of constant faults, linear trend: {constant['by_faults']} with "
        f"a life reported, after {constant['tests_with_report']} of {constant['tests']} tests\n"
    )
    console.print(target_table("prognosis", rows(figures), BESIDE))
    console.print(
        "The oracle knows faults, laws and rates exactly: what it misses is due to the noise of "
        "the growth to come and to no tracker.\n"
    )
    parts = ", ".join(f"{name} {spent:.0f} s" for name, spent in figures["durations_s"].items())
    console.print(f"{sum(figures['durations_s'].values()):.0f} s in all: {parts}")


def score_table(title: str, by_predictor: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return all metrics, by kind of fault and predictor."""
    table = Table(
        *("fault", "predictor", "CRA\n2nd half", "on event\ntime", "none\n%"),
        *(f"a-l %\n{value:g}" for value in LAMBDAS),
        *("covers\n%", "horizon\n%", "converg.\n%", "first\n%", "ms"),
        title=title,
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for number, column in enumerate(table.columns):
        column.no_wrap = True
        column.justify = "left" if number < 2 else "right"
    for kind in next(iter(by_predictor.values())):
        for number, (name, figures) in enumerate(by_predictor.items()):
            one = figures[kind]
            shares = ("coverage", "horizon_share", "convergence_share", "first_share")
            table.add_row(
                # The number of lives stands below the name.
                {0: kind.replace("_", " "), 1: f"  {one['lives']} lives"}.get(number, ""),
                name,
                f"{one['cra']:.3f}",
                f"{one['cra_event_time']:.3f}",
                f"{100.0 * one['unknown_share']:.1f}",
                *(f"{100.0 * rate:.0f}" for rate in one["alpha_lambda"].values()),
                *(f"{100.0 * one[share]:.0f}" for share in shares),
                f"{1e3 * one['seconds']:.2f}",
                end_section=number == len(by_predictor) - 1,
            )
    return table
