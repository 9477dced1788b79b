# SPDX-License-Identifier: Apache-2.0
"""Reports on a unit, or on the fleet of an archive, as a self-contained page."""

import hashlib
import io
import math
import platform
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import zip_longest
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import escape

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure

from ema_archive.fleet import FleetSummary
from ema_cli.bags.unit_course import Course, find_bags
from ema_cli.figures.fit import draw_fit
from ema_cli.figures.prognosis import draw_course
from ema_cli.report.verdict import (
    UnitVerdict,
    confusions,
    hidden_causes,
    latest_comparison,
    limited,
    tests_of,
)
from ema_cli.show.terminal import SHAPES
from ema_core import __version__
from ema_core.dates import moment
from ema_core.faults import FAULTS
from ema_core.labels import label_of
from ema_core.levels import LEVEL_NAMES
from ema_core.wording import counted
from ema_monitor.calibration.calibration import Calibration
from ema_monitor.joint import wording
from ema_monitor.joint.comparison import Comparison
from ema_monitor.plot.style import BLUE, INK, stacked_panels, tidy
from ema_monitor.prognosis.event_texts import text_of
from ema_monitor.prognosis.events import UnitEvent

_PACKAGES: Final = ("numpy", "numba", "mcap", "rosbags", "pyyaml", "matplotlib", "jinja2")
_SETTINGS: Final[dict[Any, Any]] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "ema",
    # Half a pixel of a screen: a window of 5,000 samples has ten samples per pixel.
    "path.simplify_threshold": 0.5,
}
_DECIMALS: Final = 1
"""Decimals of coordinates in figures, which are 756 points wide: 0.1 point is not visible."""

_NUMBER: Final = re.compile(r"-?\d+\.\d+")
_PATH: Final = re.compile(r'(?<= d=")[^"]+')
_PLACE: Final = re.compile(r'(?<= (?:x|y)=")-?\d+\.\d+|(?<=translate\()[^)]+')
_FONT: Final = re.compile(r"(font(?:-family)?: [^;\"]*?)'[^;\"]*sans-serif")
# Removed, because the style would apply to the whole page.
_STYLE: Final = re.compile(r"<defs><style[^>]*>.*?</style></defs>", re.DOTALL)
_NAME: Final = re.compile(r'( id="|href="#|url\(#)')
# Colours of text and frames, which are replaced by the text colour of the page.
_INKS: Final = re.compile(rf"#000000|{INK}", re.IGNORECASE)


def report_page(
    paths: Sequence[Path],
    course: Course,
    verdict: UnitVerdict,
    command: str,
    notes: Iterable[UnitEvent] = (),
) -> str:
    """Return the report on a unit as self-contained HTML.

    Parameters
    ----------
    paths
        Bags and folders of the command.
    course
        Tests of the unit, with health and life.
    verdict
        Verdict on the unit.
    command
        Command line that creates the report.
    notes
        Notes on the unit, as events.
    """
    outlooks, unit = course.outlooks, course.record.description
    faults, requirements, unknown = [], [], ""
    if outlooks:
        faults, requirements, unknown = limited(outlooks[-1], unit)
    tests, shown = tests_of(course), range(len(FAULTS))
    latest = latest_comparison(course)
    if latest is not None:
        # A record shows at most two of the faults.
        shown = [i for i in shown if any(math.isfinite(test["faults"][i][0]) for test in tests)]
        faults = [item for item in faults if math.isfinite(item["value"])]
    calibration = course.calibration
    missed = ", ".join(map(label_of, calibration.not_learned))
    return render(
        "report.html.j2",
        command,
        unit=unit,
        verdict=verdict,
        last=outlooks[-1] if outlooks else None,
        tests=[test | {"faults": [test["faults"][i] for i in shown]} for test in tests],
        components=[FAULTS[i].label for i in shown],
        faults=faults,
        requirements=requirements,
        compared=_compared(*latest) if latest else None,
        unknown=unknown,
        causes=hidden_causes(course),
        confusions=confusions(course),
        remarks=course.record.remarks,
        notes=[(moment(note.stamp_ns), text_of(note.occurrence)) for note in notes],
        pictures=list(_pictures(course)),
        files=list(_files_read(paths, course)),
        calibration={
            "identity": calibration.calibration_id,
            "from": course.options.calibration_source,
            "unit": f"{calibration.actuator_id} ({calibration.serial_number})",
            "healthy windows": str(calibration.windows),
            "residual of a healthy window": calibration.residual_text,
            "not calibrated with this unit": missed or "nothing",
        },
        search=course.options.search,
        parameters=fields(unit.parameters),
    )


def _compared(comparison: Comparison, ended: str) -> dict[str, Any]:
    """Return the table of a comparison, and advice on how to detect smaller changes."""
    smallest = {
        quantity.name: wording.smallest_text(quantity) for quantity in comparison.quantities
    }
    cells = [
        (*row, smallest.get(name, ""))
        for row, name in zip_longest(wording.rows(comparison), smallest)
    ]
    return {
        "ended": ended,
        "headings": [*wording.HEADINGS, "smallest detectable change"],
        "rows": cells,
        "improvements": wording.improvement_sentences(comparison),
    }


def fleet_page(archive: Path, fleet: FleetSummary, command: str) -> str:
    """Return the report on a fleet as self-contained HTML."""
    caption = _survival_text(fleet)
    return render(
        "fleet.html.j2",
        command,
        archive=archive,
        fleet=fleet,
        bags=_bags_text(fleet),
        label_of=label_of,
        ages=[(f"{row['from_hours']:,.4g} – {row['to_hours']:,.4g}", row) for row in fleet.ages],
        models=[(row["model"], row) for row in fleet.models],
        survival=Markup(inline_svg(draw_survival(fleet), "survival", "Survival", caption))
        if fleet.lives
        else None,
        caption=caption,
    )


def render(name: str, command: str, **content: Any) -> str:
    """Render a template of this package with the content common to all pages."""
    environment = Environment(
        loader=PackageLoader("ema_cli.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"figure": _figure}
    versions = {"ema": __version__, "Python": platform.python_version()}
    for package in _PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed as a package"
    return environment.get_template(name).render(
        shapes={LEVEL_NAMES[level]: shape for level, shape in SHAPES.items()},
        versions=versions,
        command=command,
        made=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
        **content,
    )


def _figure(value: float | None, form: str = "z.4f", scale: float = 1.0) -> Markup:
    """Return a number as HTML: rounded as text, with the exact value as data.

    A dash replaces None, NaN and infinity.
    """
    if value is None or not math.isfinite(value):
        return Markup("–")
    return Markup('<data value="{}">{}</data>').format(value, f"{scale * value:{form}}")


def _bags_text(fleet: FleetSummary) -> str:
    """Return a sentence on the bags whose tests are missing from the tables, wholly or in part.

    It is "" if there is no such bag.
    """
    counts = [
        f"{fleet.bags[name]:,} {what}"
        for name, what in (
            ("damaged", "cannot be read"),
            ("incomplete", "can be read only in part"),
            ("failed", "could not be read in the last run"),
            ("unread", "not read yet"),
        )
        if fleet.bags[name]
    ]
    if not counts:
        return ""
    words = f"Of {counted(fleet.bags['bags'], 'bag')}: {', '.join(counts)}"
    unreadable = fleet.bags["unreadable"]
    return f"{words}. Unreadable: {', '.join(unreadable)}" if unreadable else words


def _survival_text(fleet: FleetSummary) -> str:
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
    """Yield pictures and captions: fit of the last valid window, and all tests over time."""
    estimate = next((estimate for estimate in reversed(course.estimates) if estimate.valid), None)
    has_model = estimate is not None and not estimate.is_of_record
    if estimate is not None and has_model and isinstance(course.calibration, Calibration):
        last = next(window for window in course.record.windows if window.end_ns == estimate.end_ns)
        what = "Last stretch of the estimate" if estimate.stretches else "Window"
        caption = (
            f"{what} that ended at {moment(estimate.end_ns)}: measured current and speed, the "
            "model with the estimated faults and without faults, the residuals, and the faults."
        )
        figure = draw_fit(last, estimate, course.calibration, course.options.search)
        title = "Measured and estimated current and speed"
        yield Markup(inline_svg(figure, "fit", title, caption)), caption
    if (tests := len(course.outlooks)) > 1:
        caption = (
            f"Remaining useful life and faults over {counted(tests, 'valid test')}, with a panel "
            "for each fault that ends life, causes a warning or is worst. The diamond is the "
            "median end of life at that limit, the bar its 5 and 95 % quantiles."
        )
        title = "Faults and remaining life"
        yield Markup(inline_svg(draw_course(course), "course", title, caption)), caption


def _files_read(paths: Sequence[Path], course: Course) -> Iterator[tuple[str, str, int, str]]:
    """Yield path, role, size [bytes] and SHA-256 of the input files of a diagnosis."""
    windows = Counter(course.record.bags[window.end_ns] for window in course.record.windows)
    for bag in find_bags(paths):
        members = (
            sorted(item for item in bag.iterdir() if item.is_file()) if bag.is_dir() else [bag]
        )
        for member in members:
            yield _file(member, f"bag, {counted(windows[bag], 'window')} used")
    for path, role in (
        (course.options.calibration_file, "calibration"),
        (course.options.actuator_file, "description of the actuator"),
    ):
        if path is not None:
            yield _file(path, role)


def _file(path: Path, role: str) -> tuple[str, str, int, str]:
    try:
        with path.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
    except OSError as error:
        # The remarks list unreadable bags as well.
        digest = f"not read: {error.strerror}"
    return str(path), role, path.stat().st_size, digest


def draw_survival(fleet: FleetSummary) -> Figure:
    """Return a figure of the survival curve of a fleet with its 90 % interval."""
    figure, [axes] = stacked_panels([1.0], 3.2)
    steps = [{"age": 0.0, "share": 1.0, "lower": 1.0, "upper": 1.0}, *fleet.survival]
    if fleet.longest_age > steps[-1]["age"]:
        steps.append({**steps[-1], "age": fleet.longest_age})
    ages = [step["age"] for step in steps]
    low, high = (
        [math.nan if step[name] is None else step[name] for step in steps]
        for name in ("lower", "upper")
    )
    axes.fill_between(ages, low, high, step="post", color=BLUE, alpha=0.2, lw=0, label="90 %")
    axes.step(ages, [step["share"] for step in steps], where="post", color=BLUE, label="share")
    axes.set_ylim(0.0, 1.02)
    axes.set_xlim(0.0, max(fleet.longest_age, 1.0))
    axes.set_xlabel("service hours since new or repaired [h]")
    axes.set_ylabel("share without failure")
    axes.legend(loc="lower left", frameon=False)
    tidy(axes)
    return figure


def inline_svg(figure: Figure, name: str, title: str, description: str) -> str:
    """Convert a figure to a self-contained ``svg`` element.

    Parameters
    ----------
    figure
        Figure to convert.
    name
        Prefix of the identifiers in the element, unique in the page.
    title, description
        Title and description for screen readers.
    """
    file = io.StringIO()
    with rc_context(_SETTINGS):
        figure.savefig(file, format="svg", transparent=True, metadata={"Date": None})
    text = file.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = _PATH.sub(lambda match: _rounded(match[0].replace("\n", "")), text)
    text = _PLACE.sub(lambda match: _rounded(match[0]), text)
    text = _FONT.sub(r"\1sans-serif", text)
    text = _INKS.sub("currentColor", text)
    text = _NAME.sub(rf"\g<1>{name}-", text.replace("xlink:href", "href"))
    text = _STYLE.sub("", re.sub(r">\s+<", "><", text)).strip()
    width, height = (round(72.0 * inches) for inches in figure.get_size_inches())
    element = (
        f'<svg viewBox="0 0 {width} {height}" fill="currentColor" stroke-linejoin="round" '
        f'role="img" aria-labelledby="{name}-title {name}-description">'
        f'<title id="{name}-title">{escape(title)}</title>'
        f'<desc id="{name}-description">{escape(description)}</desc>'
    )
    return re.sub(r"<svg[^>]*>", lambda _: element, text, count=1)


def _rounded(numbers: str) -> str:
    return _NUMBER.sub(lambda match: f"{round(float(match[0]), _DECIMALS):g}", numbers)
