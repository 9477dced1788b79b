"""``ema calibrate``: a calibration from healthy bags."""

from pathlib import Path

import click

from ema_cli.errors import one_clear_line
from ema_cli.windows import read_windows, require_windows
from ema_monitor.calibration import calibrate as calibrate_windows
from ema_monitor.model import FORMS
from ema_monitor.window import Window


@click.command()
@click.argument("bags", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--form",
    default="fast",
    show_default=True,
    type=click.Choice(list(FORMS)),
    help="Form of the monitor model; estimates with this calibration use the same.",
)
@click.option("--actuator-id", help="Which actuator, if the bags hold several.")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="Calibration file to write.",
)
def calibrate(bags: tuple[Path, ...], form: str, actuator_id: str | None, output: Path) -> None:
    """Average the windows in BAGS of one healthy actuator into a calibration."""
    with one_clear_line():
        descriptions, windows = [], []
        for bag in bags:
            found = read_windows(bag, actuator_id)
            for remark in found.remarks:
                click.echo(f"{bag}: {remark}", err=True)
            require_windows(bag, found)
            for window in found.windows:
                if isinstance(window, Window):
                    windows.append(window)
                else:
                    click.echo(f"{bag}: a window is left out: {window.reason}", err=True)
            descriptions.append(found.description)
            if found.description != descriptions[0]:
                raise ValueError(
                    f"{bag} is of another actuator ({found.description.serial_number}) than "
                    f"{bags[0]} ({descriptions[0].serial_number}), or described otherwise"
                )
        calibration = calibrate_windows(windows, descriptions[0], form)
        calibration.save(output)
    click.echo(
        f"{output}: calibration {calibration.calibration_id} of {calibration.actuator_id} from "
        f"{calibration.windows} windows, lift {calibration.lift:.4f} A, residual of a healthy "
        f"window {calibration.healthy_rms:.4f} A"
    )
