"""The figures of prognosis.py as tables, and its targets."""

from collections.abc import Mapping
from typing import Any, Final

from prognosis_scores import JUDGED_LAMBDA, LAMBDAS
from rich import box
from rich.table import Table
from targets import Row

TARGETS: Final = {"law known": (0.90, 0.95), "law unknown": (0.80, 0.85)}
"""Least cumulative relative accuracy and least pass rate of alpha-lambda [-]."""

LOWEST_COVERAGE: Final = 0.85
HIGHEST_COVERAGE: Final = 0.95
LONGEST_S: Final = 0.02


def rows(figures: Mapping[str, Any]) -> list[Row]:
    """Return what was measured beside its targets.

    Parameters
    ----------
    figures
        What ``prognosis.measure`` returns.
    """
    result = []
    for case, where in (("drawn", "drawn estimates"), ("real", "real estimator in the loop")):
        for name, (least, rate) in TARGETS.items():
            if case not in figures:
                continue
            one = figures[case][name]["all"]
            passed = one["alpha_lambda"][f"{JUDGED_LAMBDA:g}"]
            judged = case == "drawn"
            result += [
                _row(
                    f"{one['lives']} lives, {where}, {name}: cumulative relative accuracy",
                    f">= {least:.2f}",
                    one["cra"],
                    one["cra"] >= least if judged else None,
                ),
                _row(
                    f"  alpha-lambda (20 %) at {JUDGED_LAMBDA:g}, pass rate",
                    f">= {rate:.2f}",
                    passed,
                    passed >= rate if judged else None,
                ),
                _row(
                    "  coverage of the 90 % interval",
                    f"{LOWEST_COVERAGE:.2f} to {HIGHEST_COVERAGE:.2f}",
                    one["coverage"],
                    LOWEST_COVERAGE <= one["coverage"] <= HIGHEST_COVERAGE if judged else None,
                ),
                Row(
                    "  update and prediction, processor time, median [ms]",
                    f"<= {1e3 * LONGEST_S:g}",
                    f"{1e3 * one['seconds']:.1f}",
                    one["seconds"] <= LONGEST_S if judged else None,
                ),
            ]
    for name in TARGETS:
        constant = figures["constant"][name]
        result.append(
            Row(
                f"{constant['lives']} lives of constant faults, {name}: with a life reported",
                "0",
                str(constant["reported"]),
                constant["reported"] == 0,
            )
        )
    return result


def _row(what: str, target: str, value: float, met: bool | None) -> Row:
    return Row(what, target, f"{value:.3f}", met)


def score_table(title: str, by_predictor: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return all metrics, by kind of fault and predictor."""
    table = Table(
        "fault",
        "predictor",
        "lives",
        "CRA\n2nd half",
        "to 95 %\nof life",
        "on event\ntime",
        "none\n%",
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
                "" if number else kind.replace("_", " "),
                name,
                str(one["lives"]),
                f"{one['cra']:.3f}",
                f"{one['cra_to_95']:.3f}",
                f"{one['cra_event_time']:.3f}",
                f"{100.0 * one['unknown_share']:.1f}",
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
