"""The page of a fleet: the summary of an archive, as the dashboard shows it."""

from datetime import UTC, datetime
from pathlib import Path

from markupsafe import Markup

from ema_archive.fleet import FleetSummary
from ema_cli.figures.survival import draw_survival
from ema_cli.figures.svg import inline_svg
from ema_cli.report.environment import SHAPES_BY_NAME, template
from ema_cli.report.provenance import versions
from ema_monitor.prognosis.sentences import label_of


def fleet_page(archive: Path, fleet: FleetSummary, command: str) -> str:
    """Return the report of a fleet as HTML that refers to nothing outside of itself.

    Parameters
    ----------
    archive
        Folder of the archive.
    command
        The command line.
    """
    told = survival_in_words(fleet)
    return template("fleet.html.j2").render(
        archive=archive,
        fleet=fleet,
        shapes=SHAPES_BY_NAME,
        label_of=label_of,
        ages=[(f"{row['from_hours']:,.4g} – {row['to_hours']:,.4g}", row) for row in fleet.ages],
        models=[(row["model"], row) for row in fleet.models],
        survival=Markup(inline_svg(draw_survival(fleet), "survival", "Survival", told)),
        told=told,
        versions=versions(),
        command=command,
        made=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC",
    )


def survival_in_words(fleet: FleetSummary) -> str:
    """Return what the curve of survival says."""
    lives = f"{fleet.lives:,} {'life' if fleet.lives == 1 else 'lives'}"
    if not fleet.survival:
        return f"None of {lives} has ended."
    last = fleet.survival[-1]
    return (
        f"Of {lives} {fleet.failures:,} ended; {100.0 * last['share']:.3g} % live beyond "
        f"{last['age']:,.0f} service hours."
    )
