"""Which description of the actuator holds: the one in the bag, or that of ``--actuator``."""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from ema_cli.bags.source_options import SourceOptions
from ema_core.description import ActuatorDescription


def choose_description(
    path: Path, actuator_id: str, recorded: tuple[ActuatorDescription, ...], source: SourceOptions
) -> tuple[ActuatorDescription | None, str]:
    """Return the description to read a bag with, and what there is to warn of.

    None stands for the descriptions in the bag.

    Raises
    ------
    ValueError
        When there is neither a description in the bag nor a file, or the file is none.
    """
    file = source.actuator_file
    if file is None:
        if not recorded:
            raise ValueError(
                f"{path} has no description of actuator {actuator_id!r}: give one with "
                "--actuator FILE"
            )
        return None, ""
    from ema_ros.actuator_file import load_description  # YAML only where there is a file

    given = load_description(file)
    if not recorded:
        return given, ""
    # Those of the actuator as it was described last: that is how it is reported.
    differences = "; ".join(_differences(recorded[-1], given))
    if not differences:
        return None, ""
    if source.accept_defects:
        return given, f"--actuator {file} is used against the description in the bag: {differences}"
    return (
        None,
        f"--actuator {file} is not used, the bag has a description: {differences}; "
        "--accept-defects uses the file",
    )


def _differences(recorded: Any, given: Any) -> Iterator[str]:
    """Yield name, recorded value, given value and unit of every field that differs."""
    for field in fields(recorded):
        there, here = getattr(recorded, field.name), getattr(given, field.name)
        if field.name == "parameters":
            yield from _differences(there, here)
        elif there != here:
            unit = field.metadata.get("unit", "s" if field.name == "sample_period" else "-")
            unit = "" if unit == "-" else f" {unit}"
            yield f"{field.name} {_value(there)}{unit} in the bag, {_value(here)}{unit} in the file"


def _value(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
