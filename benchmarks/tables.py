"""The figures of accuracy.py as tables."""

from collections.abc import Callable
from typing import Any

import thesis
from cases import THESIS_FAULTS
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from targets import MULTIPLE_PERCENT, Row, case_target_percent, rows

from ema_core.faults import FAULTS


def show(console: Console, figures: dict[str, Any]) -> None:
    """Print the tables."""
    console.print(target_table("accuracy", rows(figures)))
    covariance = figures["covariance"]
    console.print(
        "Single faults: mean over several realisations of the modulation; first cycle: the first "
        "of the simulation, which is always the same. Noisy sensors: 0.05 A, resolution 0.005 A, "
        "1e-6 rad, 0.05 rad/s. Their bound: half-width "
        f"{covariance['bound_half_width_percent']:.2f} % by current and ripple; "
        f"{covariance['unobservable']} of "
        f"{covariance['intervals'] + covariance['unobservable']} components called unobservable.\n"
    )
    console.print(component_table(figures))
    console.print(case_table(figures))
    console.print(
        "Mean error of the thesis's ten runs; bound: rms error of an unbiased estimate of all "
        "eight components from the current (Cramer-Rao). An estimate that keeps to the few faults "
        "it sees, and hears the speed, can be below it.\n"
    )


def target_table(title: str, rows: list[Row], beside: str = "thesis") -> Table:
    """Return what was measured beside its targets and the figures of others, as named."""
    table = Table("what", "target", "measured", "met", beside, title=title)
    for column in table.columns:
        column.no_wrap = True
    for row in rows:
        met = {None: "", True: "[green]yes[/]", False: "[bold red]no[/]"}[row.met]
        # A unit in brackets would be taken for markup.
        table.add_row(escape(row.what), row.target, row.measured, met, row.thesis)
    return table


def target_shower(
    title: str, rows_of: Callable[[dict[str, Any]], list[Row]]
) -> Callable[[Console, dict[str, Any]], None]:
    """Return what prints the targets of a script alone."""
    return lambda console, figures: console.print(target_table(title, rows_of(figures)))


def component_table(figures: dict[str, Any]) -> Table:
    """Return what is known of the uncertainty and detection of each component."""
    tests = figures["detection"]["tests"].values()
    table = Table(
        "component",
        "90 % interval\ncovers %",
        "its median\nhalf-width %",
        "that of the\nbound %",
        *(f"smallest at\n{test['z']:.2f} sigma %" for test in tests),
        title="by component, noisy sensors",
    )
    for column in table.columns[1:]:
        column.justify = "right"
    for fault in FAULTS:
        one = figures["covariance"]["by_component"][fault.name]
        table.add_row(
            fault.label,
            f"{100.0 * one['coverage']:.0f}",
            f"{one['half_width_percent']:.2f}",
            f"{one['bound_half_width_percent']:.2f}",
            # The direction of eccentricity is no fault by itself.
            *(f"{test['smallest_percent'].get(fault.name, '')}" for test in tests),
        )
    return table


def case_table(figures: dict[str, Any]) -> Table:
    """Return the thesis's cases one by one."""
    published = thesis.results()
    table = Table(
        "fault",
        "true k",
        "first\ncycle %",
        "mean\n%",
        "worst\n%",
        "target\n%",
        "bound\n%",
        "evalua-\ntions",
        "time\ns",
        *(f"{name.upper()}\n%" for name in thesis.ALGORITHMS),
        title="the thesis's cases",
    )
    table.columns[0].no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"
    for name, one in figures["thesis_cases"].items():
        by_algorithm = published[name]
        is_multiple = name == "multiple"
        target = MULTIPLE_PERCENT if is_multiple else case_target_percent(by_algorithm)
        [value] = THESIS_FAULTS[name].values() if not is_multiple else [None]
        table.add_row(
            name,
            "" if value is None else f"{value:.3f}",
            f"{one['first']:.2f}",
            f"{one['thesis']:.2f}",
            f"{max(one['each']):.2f}",
            f"{target:.2f}",
            f"{one['bound_current_percent']:.2f}",
            str(one["evaluations"]),
            f"{figures['timing']['thesis_cases_s'][name]:.3f}",
            *(f"{by_algorithm[a].error_percent:.2f}" for a in thesis.ALGORITHMS),
        )
    return table
