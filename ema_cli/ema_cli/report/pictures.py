"""Pictures of a report."""

from typing import NamedTuple

from ema_cli.figures.fit import draw_fit
from ema_cli.figures.prognosis import draw_course
from ema_cli.figures.svg import inline_svg
from ema_cli.report.words import moment
from ema_cli.unit_diagnosis import UnitDiagnosis
from ema_core.wording import counted
from ema_monitor.current_balance.unit import UnknownDriveUnit


class ReportPicture(NamedTuple):
    """A picture with its caption."""

    svg: str
    caption: str


def pictures_of(told: UnitDiagnosis, end_hours: float | None) -> list[ReportPicture]:
    """Return the fit of the last valid window, and the course of faults and life."""
    found = []
    if (fit := _last_fit(told)) is not None:
        found.append(fit)
    if (tests := len(told.course.outlooks)) > 1:
        caption = (
            f"Remaining useful life and faults over {counted(tests, 'valid test')}: what ends "
            "life, gives a warning or is worst has a panel. The diamond is the median end of life "
            "under that limit, the bar its 5 and 95 % quantiles."
        )
        figure = draw_course(told.course, end_hours)
        found.append(
            ReportPicture(
                inline_svg(figure, "course", "Faults and remaining life", caption), caption
            )
        )
    return found


def _last_fit(told: UnitDiagnosis) -> ReportPicture | None:
    """Return the fit of the last valid estimate."""
    estimate = next((one for one in reversed(told.estimates) if one.valid), None)
    if estimate is None or isinstance(told.calibration, UnknownDriveUnit):
        # Where the drive is unknown there is no model of a window to be drawn.
        return None
    last = next(one for one in told.record.windows if one.end_ns == estimate.end_ns)
    what = "Last stretch of the estimate" if estimate.stretches else "Window"
    caption = (
        f"{what} that ended at {moment(estimate.end_ns)}: current and speed as measured, as the "
        "model gives them with the estimated faults and healthy, what is left of them, and the "
        "faults."
    )
    figure = draw_fit(last, estimate, told.calibration, told.options.search)
    return ReportPicture(
        inline_svg(figure, "fit", "Measured and estimated current and speed", caption), caption
    )
