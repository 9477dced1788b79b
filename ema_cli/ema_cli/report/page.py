"""The page of a report."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from markupsafe import Markup

from ema_cli.bags.source_options import SourceOptions
from ema_cli.prognosis_options import PrognosisOptions
from ema_cli.report.environment import SHAPES_BY_NAME, template
from ema_cli.report.evidence import confusions, hidden_causes, limited, tests_of
from ema_cli.report.pictures import pictures_of
from ema_cli.report.provenance import calibration_of, files_read, parameters_of, versions
from ema_cli.report.verdict import verdict_of
from ema_cli.unit_diagnosis import UnitDiagnosis
from ema_core.faults import FAULTS


def report_page(
    paths: Sequence[Path],
    source: SourceOptions,
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
    outlooks = told.course.outlooks
    faults, requirements, unknown = limited(outlooks[-1]) if outlooks else ([], [], "")
    tests = tests_of(told)
    return template("report.html.j2").render(
        unit=told.record.description,
        verdict=verdict_of(told),
        shapes=SHAPES_BY_NAME,
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
