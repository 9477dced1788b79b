"""The figures of prognosis.py as tables, and its targets."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from prognosis_scores import JUDGED_LAMBDA, LAMBDAS, WITHOUT_DIFFUSION
from rich import box
from rich.console import Console
from rich.table import Table
from tables import target_table
from targets import Row

TARGETS: Final = {"law known": (0.90, 0.95), "law unknown": (0.80, 0.85)}
"""Least cumulative relative accuracy and least pass rate of alpha-lambda [-]."""

BESIDE: Final = "oracle / progpy"
"""Whose figures stand beside ours: an accuracy that the oracle misses nobody can reach."""

LOWEST_COVERAGE: Final = 0.85
HIGHEST_COVERAGE: Final = 0.95
LONGEST_S: Final = 0.02

_WHERE: Final = {
    "drawn": "drawn estimates",
    "real": "estimator in the loop",
    "repaired": "drawn estimates, from a repair on",
    "otherwise": "drawn estimates, by other laws",
}
_TARGETED: Final = ("drawn", "real")
_ALPHA_LAMBDA: Final = f"alpha-lambda (20 %) at {JUDGED_LAMBDA:g}, pass rate"


def rows(figures: Mapping[str, Any]) -> list[Row]:
    """Return what was measured with its targets.

    Parameters
    ----------
    figures
        What ``prognosis.measure`` returns.
    """
    result = []
    for case in _WHERE:
        for name in TARGETS:
            if name in figures.get(case, ()):
                result += _accuracy_rows(figures[case], case, name)
    for name, one in figures.get("whole", {}).items():
        result += _whole_rows(one, name)
    for name in TARGETS:
        result += _constant_rows(figures["constant"][name], name)
    return [*result, *_time_rows(figures)]


def _accuracy_rows(by_method: Mapping[str, Any], case: str, name: str) -> list[Row]:
    ours = by_method[name]
    least, rate = TARGETS[name]
    judged = case in _TARGETED
    lives = f"{ours['all']['lives']} lives, {_WHERE[case]}, {name}"
    result = []
    for kind, prefix, indent in (
        ("all", f"{lives}: ", "  "),
        (WITHOUT_DIFFUSION, f"  {WITHOUT_DIFFUSION}: ", "    "),
    ):
        for what, least_value, value in (
            (f"{prefix}cumulative relative accuracy", least, _cra),
            (f"{indent}{_ALPHA_LAMBDA}", rate, _pass_rate),
        ):
            measured = value(ours[kind])
            has_target = kind == "all" and judged
            result.append(
                Row(
                    what,
                    f">= {least_value:.2f}" if has_target else "",
                    f"{measured:.3f}",
                    measured >= least_value if has_target else None,
                    _beside(by_method, kind, value),
                )
            )
    covered = ours["all"]["coverage"]
    target = f"{LOWEST_COVERAGE:.2f} to {HIGHEST_COVERAGE:.2f}" if judged else ""
    met = LOWEST_COVERAGE <= covered <= HIGHEST_COVERAGE if judged else None
    beside = _beside(by_method, "all", _coverage)
    return [*result, Row("  coverage of the 90 % interval", target, f"{covered:.3f}", met, beside)]


def _beside(
    by_method: Mapping[str, Any], kind: str, value: Callable[[Mapping[str, Any]], float]
) -> str:
    """Return a figure of the oracle and of progpy, where it was run."""
    return " / ".join(
        f"{value(by_method[method][kind]):.3f}" if method in by_method else "-"
        for method in ("oracle", "progpy")
    )


def _coverage(one: Mapping[str, Any]) -> float:
    return one["coverage"]


def _cra(one: Mapping[str, Any]) -> float:
    return one["cra"]


def _pass_rate(one: Mapping[str, Any]) -> float:
    return one["alpha_lambda"][f"{JUDGED_LAMBDA:g}"]


def _whole_rows(one: Mapping[str, Any], name: str) -> list[Row]:
    lives, failing = one["lives"], one["by_requirement"]
    return [
        Row(
            f"{lives} lives, {failing} ended by a requirement, {name}: accuracy",
            "",
            f"{one['cra']:.3f}",
            None,
        ),
        Row(
            "  coverage of the 90 % interval, share that lies wholly beyond the truth",
            "",
            f"{one['coverage']:.3f}, {one['too_long']:.3f}",
            None,
        ),
    ]


def _constant_rows(one: Mapping[str, Any], name: str) -> list[Row]:
    reported = one["reported"]
    return [
        Row(
            f"{one['lives']} lives of constant faults, {name}: with a remaining life reported",
            "0",
            str(reported),
            reported == 0,
        ),
        Row(
            "  by a fault limit, by a requirement, by one wrongly said to fail",
            "",
            f"{one['by_faults']}, {one['by_requirements']}, {one['wrongly_reported_failing']}",
            None,
        ),
        Row(
            "  so faulty that a requirement fails from the first test on: so reported",
            "",
            f"{one['rightly_reported_failing']} of {one['failing']}",
            None,
        ),
    ]


def _time_rows(figures: Mapping[str, Any]) -> list[Row]:
    result = []
    by_method = figures["drawn"]
    for name in TARGETS:
        spent = by_method[name]["all"]["seconds"]
        result.append(
            Row(
                f"update by fault limits, {name}, processor time, median [ms]",
                f"<= {1e3 * LONGEST_S:g}",
                f"{1e3 * spent:.1f}",
                spent <= LONGEST_S,
                f"- / {1e3 * by_method['progpy']['all']['seconds']:.0f}",
            )
        )
    whole = figures["whole_update"]
    return [
        *result,
        Row(
            f"  with requirements and health, law unknown, {whole['lives']} lives, median [ms]",
            f"<= {1e3 * LONGEST_S:g}",
            f"{1e3 * whole['median_s']:.1f}",
            whole["median_s"] <= LONGEST_S,
        ),
        Row(
            "  95th percentile, first test of a unit [ms]",
            "",
            f"{1e3 * whole['p95_s']:.1f}, {1e3 * whole['first_median_s']:.0f}",
            None,
        ),
    ]


def show(console: Console, figures: Mapping[str, Any]) -> None:
    """Print the tables."""
    titles = {
        "drawn": "lives to failure, drawn estimates",
        "real": "simulator and estimator in the loop",
        "repaired": "lives with a repair of the dominant fault, drawn estimates, scored from it on",
        "otherwise": "lives by laws that are not those of the type, drawn estimates",
    }
    for case, title in titles.items():
        if case in figures:
            console.print(score_table(title, figures[case]))
    console.print(
        "RA: 1 - |r* - r| / r*, r the median of the remaining useful life and r* the truth; mean "
        "over lives at shares of the time from the first prediction to the end. CRA: its mean over "
        "the tests in the second half of life; no prediction counts 0. On time of event, for "
        "comparison: the same predictions by 1 - |r* - r| / EoL, and by progpy's own function, of "
        "their mean, without tests that predict nothing. a-l: lives in which at least half of the "
        "probability is within 20 % of r* at that share. covers: 90 % intervals that hold the "
        "truth, of all tests and of those in the second half. horizon, convergence, first "
        "prediction, time: medians over lives; of the whole life, of the time from first "
        "prediction to end, of the whole life. Time: processor time a test.\n"
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
        "fault",
        "predictor",
        "CRA\n2nd half",
        "to 95 %\nof life",
        "on event\ntime",
        "by\nprogpy",
        "none\n%",
        *(f"RA\n{value:g}" for value in LAMBDAS),
        *(f"a-l %\n{value:g}" for value in LAMBDAS),
        "covers\n%",
        "late\n%",
        "horizon\n%",
        "converg.\n%",
        "first\n%",
        "ms",
        title=title,
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    for number, column in enumerate(table.columns):
        column.no_wrap = True
        column.justify = "left" if number < 2 else "right"
    kinds = next(iter(by_predictor.values()))
    for kind in kinds:
        for number, (name, figures) in enumerate(by_predictor.items()):
            one = figures[kind]
            table.add_row(
                # The number of lives stands below the name.
                {0: kind.replace("_", " "), 1: f"  {one['lives']} lives"}.get(number, ""),
                name,
                f"{one['cra']:.3f}",
                f"{one['cra_to_95']:.3f}",
                f"{one['cra_event_time']:.3f}",
                _figure(one["cra_by_progpy"], ".3f"),
                f"{100.0 * one['unknown_share']:.1f}",
                *(f"{value:.2f}" for value in one["accuracy"].values()),
                *(f"{100.0 * rate:.0f}" for rate in one["alpha_lambda"].values()),
                f"{100.0 * one['coverage']:.0f}",
                f"{100.0 * one['coverage_late']:.0f}",
                f"{100.0 * one['horizon_share']:.0f}",
                f"{100.0 * one['convergence_share']:.0f}",
                f"{100.0 * one['first_share']:.0f}",
                f"{1e3 * one['seconds']:.2f}",
                end_section=number == len(by_predictor) - 1,
            )
    return table


def _figure(value: float, form: str) -> str:
    return "" if value != value else format(value, form)
