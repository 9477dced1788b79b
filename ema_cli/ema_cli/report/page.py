"""Reports as one page that needs nothing beside it: of a unit, or of the fleet of an archive."""

import hashlib
import math
import platform
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ema_archive.fleet import FleetSummary
from ema_cli.bags.unit_course import Course
from ema_cli.bags.unit_record import find_bags
from ema_cli.figures.fit import draw_fit
from ema_cli.figures.prognosis import draw_course
from ema_cli.figures.survival import draw_survival
from ema_cli.figures.svg import inline_svg
from ema_cli.report.evidence import confusions, hidden_causes, limited, moment, tests_of
from ema_cli.report.verdict import UnitVerdict
from ema_cli.show.levels import SHAPES
from ema_core import __version__
from ema_core.faults import FAULTS
from ema_core.levels import LEVEL_NAMES
from ema_core.wording import counted
from ema_monitor.current_balance.unit import UnknownDriveUnit
from ema_monitor.prognosis.sentences import label_of

_PACKAGES: Final = ("numpy", "numba", "mcap", "rosbags", "pyyaml", "matplotlib", "jinja2")


def report_page(paths: Sequence[Path], course: Course, verdict: UnitVerdict, command: str) -> str:
    """Return a report as HTML that refers to nothing outside of itself."""
    outlooks, unit = course.outlooks, course.record.description
    faults, requirements, unknown = limited(outlooks[-1]) if outlooks else ([], [], "")
    return _page(
        "report.html.j2",
        command,
        unit=unit,
        verdict=verdict,
        last=outlooks[-1] if outlooks else None,
        tests=tests_of(course),
        components=[fault.label for fault in FAULTS],
        faults=faults,
        requirements=requirements,
        unknown=unknown,
        causes=hidden_causes(course),
        confusions=confusions(course),
        remarks=course.record.remarks,
        pictures=list(_pictures(course)),
        files=list(_files_read(paths, course)),
        calibration=_calibration_of(course),
        search=course.given.search,
        parameters=fields(unit.parameters),
    )


def fleet_page(archive: Path, fleet: FleetSummary, command: str) -> str:
    """Return the report of a fleet as HTML that refers to nothing outside of itself."""
    told = _survival_in_words(fleet)
    return _page(
        "fleet.html.j2",
        command,
        archive=archive,
        fleet=fleet,
        label_of=label_of,
        ages=[(f"{row['from_hours']:,.4g} – {row['to_hours']:,.4g}", row) for row in fleet.ages],
        models=[(row["model"], row) for row in fleet.models],
        survival=Markup(inline_svg(draw_survival(fleet), "survival", "Survival", told))
        if fleet.lives
        else None,
        told=told,
    )


def _page(name: str, command: str, **content: Any) -> str:
    environment = Environment(
        loader=PackageLoader("ema_cli.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"figure": _figure}
    return environment.get_template(name).render(
        shapes={LEVEL_NAMES[level]: shape for level, shape in SHAPES.items()},
        versions=_versions(),
        command=command,
        made=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
        **content,
    )


def _figure(value: float | None, form: str = "z.4f", scale: float = 1.0) -> Markup:
    """Return a figure rounded for the eye, and exactly for programs."""
    if value is None or not math.isfinite(value):
        return Markup("–")
    return Markup('<data value="{}">{}</data>').format(value, f"{scale * value:{form}}")


def _survival_in_words(fleet: FleetSummary) -> str:
    lives = f"{fleet.lives:,} {'life' if fleet.lives == 1 else 'lives'}"
    if not fleet.lives:
        return "No unit has a test with known service hours."
    if not fleet.survival:
        return f"None of {lives} has ended."
    last = fleet.survival[-1]
    return (
        f"Of {lives} {fleet.failures:,} ended; {100.0 * last['share']:.3g} % live beyond "
        f"{last['age']:,.0f} service hours."
    )


def _pictures(course: Course) -> Iterator[tuple[Markup, str]]:
    """Yield pictures with captions: the fit of the last valid window, the course of all tests."""
    estimate = next((one for one in reversed(course.estimates) if one.valid), None)
    # Where the drive is unknown there is no model of a window to be drawn.
    if estimate is not None and not isinstance(course.calibration, UnknownDriveUnit):
        last = next(one for one in course.record.windows if one.end_ns == estimate.end_ns)
        what = "Last stretch of the estimate" if estimate.stretches else "Window"
        caption = (
            f"{what} that ended at {moment(estimate.end_ns)}: current and speed as measured, as "
            "the model gives them with the estimated faults and healthy, what is left of them, and "
            "the faults."
        )
        figure = draw_fit(last, estimate, course.calibration, course.given.search)
        title = "Measured and estimated current and speed"
        yield Markup(inline_svg(figure, "fit", title, caption)), caption
    if (tests := len(course.outlooks)) > 1:
        caption = (
            f"Remaining useful life and faults over {counted(tests, 'valid test')}: what ends "
            "life, gives a warning or is worst has a panel. The diamond is the median end of life "
            "under that limit, the bar its 5 and 95 % quantiles."
        )
        title = "Faults and remaining life"
        yield Markup(inline_svg(draw_course(course), "course", title, caption)), caption


def _files_read(paths: Sequence[Path], course: Course) -> Iterator[tuple[str, str, int, str]]:
    """Yield path, role, bytes and SHA-256 of the files that a diagnosis rests on."""
    windows = Counter(course.record.bags[window.end_ns] for window in course.record.windows)
    for bag in find_bags(paths):
        members = (
            sorted(item for item in bag.iterdir() if item.is_file()) if bag.is_dir() else [bag]
        )
        for member in members:
            yield _file(member, f"bag, {counted(windows[bag], 'window')} used")
    for path, role in (
        (course.given.calibration_file, "calibration"),
        (course.given.actuator_file, "description of the actuator"),
    ):
        if path is not None:
            yield _file(path, role)


def _file(path: Path, role: str) -> tuple[str, str, int, str]:
    try:
        with path.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
    except OSError as error:
        # A bag that could not be read is named among the remarks as well.
        digest = f"not read: {error.strerror}"
    return str(path), role, path.stat().st_size, digest


def _calibration_of(course: Course) -> dict[str, str]:
    """Return what identifies the calibration, by what it is."""
    one = course.calibration
    missed = ", ".join(name.replace("_", " ") for name in one.not_learned)
    return {
        "identity": one.calibration_id,
        "from": course.given.calibration_source,
        "unit": f"{one.actuator_id} ({one.serial_number})",
        "healthy windows": str(one.windows),
        "residual of a healthy window": one.residual_in_words,
        "not learned of the unit": missed or "nothing",
    }


def _versions() -> dict[str, str]:
    """Return the versions of what made the report, by name."""
    found = {"ema": __version__, "Python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed as a package"
    return found
