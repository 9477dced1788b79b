# SPDX-License-Identifier: Apache-2.0
"""Detection of the windows in a bag, and command options that select them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import click

from ema_bags.recording import Recording
from ema_bags.suffixes import TABLES
from ema_bags.telemetry import read_telemetry
from ema_cli.options import values_of_options
from ema_cli.parameters import Command, Parameters
from ema_cli.progress import progress_bar
from ema_core.description import ActuatorDescription
from ema_core.quantity import Checked, quantity
from ema_core.telemetry import Telemetry
from ema_monitor.model.measured import GRAMMAR, measured_causes_of
from ema_monitor.model.measurements import MAX_AGE_S
from ema_monitor.reason_texts import text_of
from ema_monitor.recordings.finding import find_recorded_windows
from ema_monitor.recordings.windows import BagWindows
from ema_monitor.windows.records import LEAST_MOTION_S
from ema_monitor.windows.trigger import ANY_MOTION, TriggerSettings
from ema_monitor.windows.window import MIN_TRAVEL

ACTUATOR_OPTION: Final = click.option(
    "--actuator",
    "actuator_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Actuator file (YAML), if BAG has no description.",
)


@dataclass(frozen=True)
class ReadingOptions(Checked):
    """Command options that select the part of a bag to read."""

    OPTIONS: ClassVar[tuple[Callable[[Command], Command], ...]] = (
        click.option("--actuator-id", help="Actuator to read, if BAG has several."),
        ACTUATOR_OPTION,
        click.option("--topic", help="Telemetry topic to read, if BAG has several."),
        click.option(
            "--any-motion", is_flag=True, help="Use stretches of ordinary motion as windows."
        ),
    )
    SECTIONS: ClassVar[tuple[tuple[Any, str], ...]] = ()

    actuator_id: str | None = None
    actuator_file: Path | None = None
    topic: str | None = None
    any_motion: bool = False
    accept_defects: bool = False
    """Whether to continue despite defects: ``actuator_file`` overrides the bag's description, and a
    calibration is used even if it does not fit."""
    measured: tuple[str, ...] = ()
    """Measured hidden causes of all windows, in the notation `GRAMMAR`."""
    measured_max_age_s: float = quantity(
        MAX_AGE_S,
        "s",
        0.0,
        1e7,
        "largest age of a measured cause at the start of a window that uses it",
    )
    """Largest age of a recorded measurement at the start of a window [s]."""
    trigger: TriggerSettings = TriggerSettings()  # noqa: RUF009 - frozen

    @classmethod
    def of(cls, parameters: Parameters, **options: Any) -> Self:
        """Build the settings from options and parameters. Raises ValueError for invalid values."""
        windows = ANY_MOTION if options.pop("any_motion", False) else None
        trigger = parameters.with_options(windows=windows).over(TriggerSettings())
        options["actuator_file"] = options["actuator_file"] or parameters.path("actuator_file")
        is_any = trigger.windows == ANY_MOTION
        return parameters.over(cls(any_motion=is_any, trigger=trigger, **options))


ReadingOptions.SECTIONS = ((TriggerSettings, ""), (ReadingOptions, ""))

MEASURED_OPTION: Final = click.option(
    "--measured",
    multiple=True,
    help=f"Measured hidden cause {GRAMMAR}, e.g. load_torque=0.1:0.005.",
)
"""Option of commands that identify windows."""


def accept_option(meaning: str = "Use --actuator although it contradicts BAG.") -> Any:
    """Return the option ``--accept-defects``; ``meaning`` is the help text."""
    return click.option("--accept-defects", is_flag=True, help=meaning)


def open_recording(path: Path, source: ReadingOptions) -> tuple[Recording, ReadingOptions]:
    """Open a bag, or a table with the mapping in its folder; return it with its options.

    For a table, the actuator file is already applied: the returned options omit it.
    """
    if path.suffix.lower() not in TABLES:
        from ema_bags.reader import Bag  # imports rosbags and mcap only for bags

        return Bag(path), source
    from ema_cli.bags.records import table_recordings  # imported only for tables

    [(_, recording)] = table_recordings(path, source.actuator_file)
    return recording, replace(source, actuator_file=None)


def read_windows(
    path: Path,
    source: ReadingOptions,
    on_block: Callable[[Telemetry], None] | None = None,
    bag: Recording | None = None,
    *,
    with_duty: bool = False,
) -> BagWindows:
    """Read a bag and detect the windows in its telemetry, with a progress bar.

    Parameters
    ----------
    path
        Path of the bag or table.
    source
        Options that select the part to read.
    on_block
        Called with each block of telemetry.
    bag
        Bag or table recording, if already open.
    with_duty
        Whether to measure the duty.

    Raises
    ------
    ValueError
        If the telemetry cannot be read or has no description.
    """
    with values_of_options():
        measured = measured_causes_of(source.measured)
    if bag is None:
        bag, source = open_recording(path, source)
    recorded = read_telemetry(bag, source.topic, source.actuator_id)
    description, warning = None, ""
    if source.actuator_file is not None:
        description, warning = _choose_description(
            source.actuator_file, recorded.descriptions, accept=source.accept_defects
        )
    elif not recorded.descriptions:
        reason = (
            f"{path} has no description of actuator {recorded.actuator_id!r}: pass --actuator FILE"
        )
        raise ValueError("; ".join(filter(None, (reason, bag.damage))))
    with progress_bar() as progress:
        total = recorded.bag.topics[recorded.topic].count
        task = progress.add_task(f"reading {path}", total=total)

        def follow(block: Telemetry) -> None:
            progress.advance(task)
            if on_block is not None:
                on_block(block)

        windows = find_recorded_windows(
            recorded,
            source.trigger,
            description=description,
            measured=measured,
            measured_max_age_s=source.measured_max_age_s,
            on_block=follow,
            with_duty=with_duty,
        )
    windows.remarks[:0] = [*filter(None, [warning]), *windows.description.remarks]
    return windows


def identifiable_windows(
    path: Path, source: ReadingOptions, bag: Recording | None = None
) -> BagWindows:
    """Detect the windows in a bag, at least one, and print the remarks.

    Raises
    ------
    ValueError
        If the bag has no window; the message states the reason.
    """
    windows = read_windows(path, source, bag=bag)
    for remark in windows.remarks:
        click.echo(f"{path}: {remark}", err=True)
    if not windows.windows:
        raise ValueError(why_no_window(path, windows, source))
    return windows


def why_no_window(path: Path, bag_windows: BagWindows, source: ReadingOptions) -> str:
    """Return the reason why a bag has no window, from the motion of command or position."""
    settings = source.trigger
    obstacle = text_of(bag_windows.obstacle) if bag_windows.obstacle else ""
    if not bag_windows.description.is_modelled:
        reason = obstacle or (
            f"a record requires {LEAST_MOTION_S:g} s of motion, but the position never changes"
        )
        return f"{path} has no record to diagnose (no excitation): {reason}"
    if source.any_motion:
        if obstacle:
            return f"{path} has no window to diagnose: {obstacle}"
        return (
            f"{path} has no motion to diagnose (no excitation): the command never travels "
            f"{MIN_TRAVEL:g} rad within {settings.window_s:g} s"
        )
    if not bag_windows.has_rested:
        behaviour = (
            f"it never rested within {settings.threshold:g} rad for {settings.rest_s:g} s: check "
            "that the parameter threshold_urad exceeds its noise"
        )
    elif bag_windows.longest_motion_s:
        behaviour = (
            f"it moved for at most {bag_windows.longest_motion_s:.3f} s at a time, or in one "
            "direction only"
        )
    else:
        behaviour = "it never moved"
    return (
        f"{path} has no window to diagnose (no excitation): a window requires a command moving "
        f"back and forth for {settings.window_s:g} s after a rest (--any-motion: any motion), "
        f"but {behaviour}" + (f"; {obstacle}" if obstacle else "")
    )


def _choose_description(
    file: Path, recorded: tuple[ActuatorDescription, ...], *, accept: bool
) -> tuple[ActuatorDescription | None, str]:
    """Return the description to use instead of the bag's descriptions, and a warning.

    The description is None if the bag's descriptions are used.
    """
    from ema_ros.actuator_file import load_description  # imports YAML only if there is a file

    described = load_description(file)
    if not recorded:
        return described, ""
    # Compare with the last recorded description, which reports use.
    differences = "; ".join(differing(recorded[-1], described, "the bag", "the file"))
    if not differences:
        return None, ""
    if accept:
        return (described, f"--actuator {file} overrides the description in the bag: {differences}")
    return (
        None,
        f"--actuator {file} is ignored, because the bag has a description: {differences}; use "
        "--accept-defects to override it",
    )


def differing(first: Any, second: Any, first_place: str, second_place: str) -> Iterator[str]:
    """Yield a string with name, unit and both values of each field that differs."""
    for field in fields(first):
        value, second_value = getattr(first, field.name), getattr(second, field.name)
        if field.name in ("parameters", "acquisition"):
            yield from differing(value, second_value, first_place, second_place)
        elif value != second_value:
            unit = field.metadata.get("unit", "s" if field.name == "sample_period" else "-")
            unit = "" if unit == "-" else f" {unit}"
            yield (
                f"{field.name} {_value(value)}{unit} in {first_place}, "
                f"{_value(second_value)}{unit} in {second_place}"
            )


def _value(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
