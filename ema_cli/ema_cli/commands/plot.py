# SPDX-License-Identifier: Apache-2.0
"""``ema plot``: draw telemetry, fit and faults of a bag."""

from pathlib import Path

import click
from matplotlib.figure import Figure

from ema_cli.bags.diagnoses import DiagnosisLog, read_history
from ema_cli.bags.identifying import ALGORITHM_OPTION, Identifying
from ema_cli.bags.reading import read_windows
from ema_cli.comparison import choose_window
from ema_cli.figures.files import PICTURES, picture_option, save_picture
from ema_cli.figures.fit import draw_fit
from ema_cli.figures.history import draw_history
from ema_cli.figures.telemetry import Outline, draw_telemetry
from ema_cli.output import require_free
from ema_cli.parameters import settings_options
from ema_core.wording import counted
from ema_monitor.recordings.windows import BagWindows
from ema_monitor.windows.trigger import Refusal


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@settings_options(Identifying, more=[ALGORITHM_OPTION])
@click.option(
    "--window",
    "number",
    type=click.IntRange(0),
    help=(
        "Window whose fit is shown, from 0. With --any-motion: the estimate, shown with its last "
        "stretch."
    ),
)
@click.option(
    "--history",
    "as_history",
    is_flag=True,
    help="Draw the recorded estimates, and true faults if recorded, over test cycles.",
)
@picture_option("; by default next to the bag")
def plot(
    bag: Path,
    options: Identifying,
    number: int | None,
    as_history: bool,
    output: Path | None,
    overwrite: bool,
) -> None:
    """Draw the telemetry of BAG with its windows; with --window, also fit and faults."""
    if as_history and number is not None:
        raise click.UsageError("--history and --window exclude each other")
    output = output or bag.with_suffix(".png")
    require_free(output, [bag], overwrite=overwrite, endings=PICTURES)
    outline = Outline()
    if as_history:
        recorded = read_history(bag, options.actuator_id)
    else:
        recorded = read_windows(bag, options, outline.add)
    for remark in recorded.remarks:
        click.echo(f"{bag}: {remark}", err=True)
    if isinstance(recorded, DiagnosisLog):
        figure = draw_history(recorded)
    elif number is None:
        figure = draw_telemetry(recorded, outline)
    else:
        options = options.with_calibration_beside([bag])
        figure = _draw_estimate(recorded, number, options)
    save_picture(figure, output)
    click.echo(f"{output}")


def _draw_estimate(bag_windows: BagWindows, number: int, options: Identifying) -> Figure:
    """Return a figure of the fit of a window, or of the last stretch of ordinary motion."""
    windows, what = bag_windows.windows, "estimate"
    if not options.any_motion:
        what, window = "window", choose_window(bag_windows, number)
        if isinstance(window.place, Refusal):
            raise ValueError(f"window {number} cannot be used: {window.place.reason}")
        # Include the earlier windows, because a warm search starts from their estimates.
        windows = windows[: number + 1]
    calibration = options.calibration_of_model()
    estimates = options.estimate(windows, calibration)
    if number >= len(estimates):
        count = counted(len(estimates), "estimate")
        raise ValueError(f"--window {number}: the motion has {count}, numbered from 0")
    estimate = estimates[number]
    if not estimate.valid:
        raise ValueError(f"{what} {number} has no estimate: {estimate.reason}")
    last = next(item for item in windows if item.end_ns == estimate.end_ns)
    return draw_fit(last, estimate, calibration, options.search, bag_windows.first_ns)
