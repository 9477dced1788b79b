"""The page of a report."""

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from ema_cli.bags.source_options import Source
from ema_cli.prognosis_options import PrognosisOptions
from ema_cli.report.evidence import confusions, hidden_causes, limited, tests_of
from ema_cli.report.pictures import pictures_of
from ema_cli.report.provenance import calibration_of, files_read, parameters_of, versions
from ema_cli.report.verdict import verdict_of
from ema_cli.show.levels import SHAPES
from ema_cli.unit_diagnosis import UnitDiagnosis
from ema_core.faults import FAULTS
from ema_core.levels import LEVEL_NAMES

_SHAPES = {LEVEL_NAMES[level]: shape for level, shape in SHAPES.items()}


def report_page(
    paths: Sequence[Path],
    source: Source,
    prognosis: PrognosisOptions,
    told: UnitDiagnosis,
    command: str,
) -> str:
    """Return a report as HTML that refers to nothing outside of itself.

    Parameters
    ----------
    paths
        Bags as they were given.
    command
        The command line.

    Raises
    ------
    OSError
        When a file that was read is gone.
    """
    environment = Environment(
        loader=PackageLoader("ema_cli.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"figure": _figure}
    outlooks = told.course.outlooks
    faults, requirements, unknown = limited(outlooks[-1]) if outlooks else ([], [], "")
    tests = tests_of(told)
    return environment.get_template("report.html.j2").render(
        unit=told.record.description,
        verdict=verdict_of(told),
        shapes=_SHAPES,
        last=outlooks[-1] if outlooks else None,
        tests=tests,
        components=[fault.label for fault in FAULTS],
        faults=faults,
        requirements=requirements,
        unknown=unknown,
        causes=hidden_causes(told),
        confusions=confusions(told),
        remarks=told.record.remarks,
        pictures=[
            {"svg": Markup(one.svg), "caption": one.caption}
            for one in pictures_of(told, prognosis.end_hours)
        ],
        files=files_read(paths, source, told),
        calibration=calibration_of(told),
        search=told.options.search,
        parameters=parameters_of(told),
        versions=versions(),
        command=command,
        made=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
    )


def _figure(value: float, form: str = "z.4f", scale: float = 1.0) -> Markup:
    """Return a figure rounded for the eye, and exactly for programs."""
    if not math.isfinite(value):
        return Markup("–")
    return Markup('<data value="{}">{}</data>').format(value, f"{scale * value:{form}}")
