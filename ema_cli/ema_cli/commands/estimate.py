# SPDX-License-Identifier: Apache-2.0
"""``ema estimate``: estimate the faults in a bag."""

import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from textwrap import shorten
from typing import Any, Final

import click

from ema_cli.bags.identifying import ALGORITHM_OPTION, Identifying, as_object
from ema_cli.bags.reading import identifiable_windows
from ema_cli.options import REFUSED
from ema_cli.parameters import settings_options
from ema_core.faults import FAULTS, INDICES
from ema_core.linear import physical, travel_shown
from ema_core.wording import counted
from ema_monitor.identification.estimate import Estimate, Verdict
from ema_monitor.joint.wording import change_text, finding, improvement_sentences, quantity_label
from ema_monitor.quantities import FRICTION, QUANTITIES
from ema_monitor.recordings.windows import BagWindows
from ema_monitor.windows.window import MIN_TRAVEL

_NOTHING: Final = "no significant fault"
_REASON_WIDTH: Final = 90
_FINDING_WIDTH: Final = 200


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@settings_options(Identifying, more=[ALGORITHM_OPTION])
@click.option("--json", "as_json", is_flag=True, help="Print a list with an object per window.")
@click.option("-v", "--verbose", is_flag=True, help="Print a table per window.")
def estimate(bag: Path, options: Identifying, as_json: bool, verbose: bool) -> None:
    """Estimate the faults in each window of BAG, with their uncertainty.

    A single window is shown as a table, several windows as one line each with a summary. With
    --any-motion, stretches of ordinary motion are combined until a fault reaches the parameter
    wanted_sigma. There is a line for each combination, with the faults that the motion does not
    determine. A record of an unknown drive is compared with the healthy records of its calibration:
    a table shows the change of each quantity. Exit code 3: a window or record is refused, a record
    determines no quantity, or it departs from the healthy records.
    """
    options = options.with_calibration_beside([bag])
    calibration = options.calibration()
    bag_windows = identifiable_windows(bag, options)
    estimates = options.estimate(bag_windows.windows, calibration)
    if as_json:
        click.echo(json.dumps([as_object(e, bag_windows) for e in estimates], indent=2))
    else:
        click.echo(f"calibration {calibration.calibration_id} ({options.calibration_source})")
        for number, result in enumerate(estimates):
            if verbose or len(estimates) == 1:
                _print(number, result, bag_windows)
            else:
                click.echo(_line(number, result, bag_windows))
        if len(estimates) > 1:
            click.echo("\n".join(_summary(estimates)))
        if not estimates:
            click.echo("no estimate: no fault reached wanted_sigma")
        if not options.calibration_file and calibration.unit_mismatch(bag_windows.description):
            click.echo(
                "calibrate this unit: `ema calibrate HEALTHY_BAG -o FILE`, then --calibration FILE"
            )
    # A live recording may end at any time: an incomplete last window is not a failure.
    complete = [result for result in estimates if result.verdict != Verdict.SKIPPED]
    if not complete or not all(map(_is_answer, complete)):
        sys.exit(REFUSED)


def _is_answer(estimate: Estimate) -> bool:
    """Return whether an estimate is valid and not a departure; a record must determine friction."""
    is_open = estimate.comparison is not None and not estimate.comparison[FRICTION].is_judged
    return estimate.valid and estimate.verdict != Verdict.DEPARTED and not is_open


def _distance(estimate: Estimate, i: int) -> float:
    """Return the distance of a fault from its healthy value [-]."""
    return abs(estimate.faults[i] - FAULTS[i].healthy)


def _significant(estimate: Estimate) -> list[int]:
    """Return the indices of the significant faults, largest first."""
    return sorted(
        filter(lambda i: estimate.found[i], INDICES), key=lambda i: -_distance(estimate, i)
    )


def _line(number: int, estimate: Estimate, bag_windows: BagWindows) -> str:
    """Format the estimate of a window as one line."""
    place = f"{number:4d} {bag_windows.seconds(estimate.start_ns):10.2f} s"
    if estimate.is_of_record:
        place += f" to {bag_windows.seconds(estimate.end_ns):.2f} s"
    elif estimate.stretches:
        stretches = counted(estimate.stretches, "stretch")
        place += f" to {bag_windows.seconds(estimate.end_ns):.2f} s, {stretches}"
    if estimate.comparison is not None:
        what = shorten(finding(estimate.comparison), _FINDING_WIDTH, placeholder=" ...")
        return f"{place}  {estimate.verdict:8s} {what}"
    if not estimate.valid or estimate.verdict == Verdict.DEPARTED:
        verdict = Verdict.DEPARTED if estimate.verdict == Verdict.DEPARTED else Verdict.REFUSED
        return (
            f"{place}  {verdict:8s} {shorten(estimate.reason, _REASON_WIDTH, placeholder=' ...')}"
        )
    faults = [
        f"{FAULTS[i].label} {estimate.faults[i]:.4f} ± {estimate.sigma[i]:.4f}"
        for i in _significant(estimate)
    ]
    causes = list(map(str, estimate.causes))
    words = ", ".join(faults + causes) or _NOTHING
    if estimate.measured:
        measured = map(str, estimate.measured)
        words += f"; measured: {', '.join(measured)}"
    unknown = [FAULTS[i].label for i in INDICES if estimate.unobservable[i]]
    if estimate.stretches and unknown:
        words += f"; not determined: {', '.join(unknown)}"
    return f"{place}  {estimate.verdict:8s} {words}"


def _summary(estimates: Sequence[Estimate]) -> list[str]:
    """Return lines with the verdicts, the reasons of refusals and the largest faults."""
    valid = [(number, item) for number, item in enumerate(estimates) if item.valid]
    counts = Counter(item.verdict for item in estimates)
    are_records = any(item.is_of_record for item in estimates)
    rarest = Verdict.DEGRADED if are_records else Verdict.DEPARTED
    seldom = (Verdict.FAILED, Verdict.SKIPPED, rarest)
    named = [name for name in Verdict if counts[name] or name not in seldom]
    verdicts = ", ".join(f"{counts[name]} {name}" for name in named)
    what = "estimate" if any(item.stretches for item in estimates) else "window"
    what = "record" if are_records else what
    lines = [f"{counted(len(estimates), what)}: {verdicts}"]
    refused: dict[tuple[Any, ...], list[Estimate]] = {}
    for entry in estimates:
        if not entry.valid:
            kinds = tuple(reason.kind for reason in entry.reasons)
            refused.setdefault((entry.verdict, *kinds), []).append(entry)
    for alike in refused.values():
        example = "" if len({entry.reason for entry in alike}) == 1 else "for example "
        lines.append(f"{len(alike)} refused: {example}{alike[0].reason}")
    if are_records:
        changes = _largest_changes(estimates)
        return [*lines, f"largest: {changes}"] if changes else lines
    words = []
    for i, fault in enumerate(FAULTS):
        with_fault = [(number, item) for number, item in valid if i in _significant(item)]
        if with_fault:
            number, entry = max(with_fault, key=lambda item: _distance(item[1], i))
            words.append(f"{fault.label} {entry.faults[i]:.3f} (window {number})")
    if valid:
        lines.append(f"largest: {', '.join(words) or _NOTHING}")
    return lines


def _largest_changes(estimates: Sequence[Estimate]) -> str:
    """Return the largest change of each quantity, with its record, as text; "" without changes."""
    words = []
    for name in QUANTITIES:
        changes = [
            (number, change)
            for number, estimate in enumerate(estimates)
            for change in (estimate.comparison.changed if estimate.comparison else ())
            if change.name == name
        ]
        if changes:
            number, largest = max(changes, key=lambda estimate: abs(estimate[1].change))
            words.append(f"{quantity_label(name)} {change_text(largest)} (record {number})")
    return ", ".join(words)


def _print(number: int, estimate: Estimate, bag_windows: BagWindows) -> None:
    start, end = bag_windows.seconds(estimate.start_ns), bag_windows.seconds(estimate.end_ns)
    if estimate.is_of_record:
        click.echo(f"record {number}, {start:.1f} s to {end:.1f} s\n{estimate}")
        if estimate.comparison is not None:
            lines = improvement_sentences(estimate.comparison)
            lines.append(
                f"{estimate.computing_time:.2f} s of computing; calibration of "
                f"{counted(estimate.calibration_windows, 'healthy record')}"
            )
            click.echo("\n".join(lines))
        return
    what = counted(estimate.stretches, "stretch") if estimate.stretches else f"window {number}"
    title = f"{what}, {start:.4f} s to {end:.4f} s"
    click.echo(f"{title}\n{estimate}")
    if not estimate.valid:
        return
    unit = bag_windows.description
    faults = [
        f"{FAULTS[i].label} {k:.3f} ({physical(FAULTS[i].name, k, unit)})"
        for i in _significant(estimate)
        for k in (estimate.faults[i],)
    ]
    shown = travel_shown(unit.parameters)
    if faults or estimate.verdict != Verdict.DEPARTED:
        click.echo(f"found: {'; '.join(faults) or _NOTHING}")
    click.echo(
        f"fitness {estimate.fitness:.5f} A^2.s; command travels "
        f"{shown.text(estimate.excitation)} (at least {shown.text(MIN_TRAVEL)} required)"
    )
    click.echo(
        f"{estimate.algorithm}, {'warm' if estimate.warm_start else 'cold'}: "
        f"{counted(estimate.evaluations, 'evaluation')} in {estimate.computing_time:.2f} s; "
        f"calibration of {counted(estimate.calibration_windows, 'window')}"
    )
