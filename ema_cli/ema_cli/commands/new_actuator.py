# SPDX-License-Identifier: Apache-2.0
"""``ema new-actuator``: describe an actuator with the values in its data sheet."""

import json
from collections.abc import Callable
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, Final

import click

from ema_cli.output import output_option, require_free
from ema_core.description import ActuatorDescription
from ema_core.files import complete_file
from ema_core.linear import in_si
from ema_core.parameters import RPM

_FIGURES: Final[dict[str, tuple[str, str, Callable[[float], dict[str, Any]]]]] = {
    "gear": ("-", "Motor turns per turn of the output shaft or screw", lambda x: {"tau": 1 / x}),
    "lead": ("mm", "Travel per screw turn, for a linear actuator", lambda x: {"lead": x / 1e3}),
    "supply": ("V", "Supply voltage", lambda x: {"V_max": x}),
    "kv": ("rpm/V", "Speed constant", lambda x: dict.fromkeys(("k_e", "k_t"), 1 / (x * RPM))),
    "torque-constant": ("N.m/A", "Torque constant", lambda x: {"k_t": x, "k_e": x}),
    "resistance": ("ohm", "Resistance, phase to phase", lambda x: {"R_s": x}),
    "inductance": ("mH", "Inductance, phase to phase", lambda x: {"L_s": 1e-3 * x}),
    "pole-pairs": ("-", "Pole pairs", lambda x: {"P": x}),
    "current": ("A", "Largest current", lambda x: {"I_max": x}),
    "speed": ("rpm", "Largest speed of the motor", lambda x: {"omega_max": x * RPM}),
    "inertia": ("kg.m^2", "Inertia of the motor", lambda x: {"J_m": x}),
    "stroke": ("mm", "Travel of the rod from end to end", lambda x: {"theta_stop": f"{x / 2} mm"}),
    "rod-speed": ("mm/s", "Largest speed of the rod", lambda x: {"omega_max": f"{x} mm/s"}),
    "rod-friction": ("N", "Dry friction at the rod", lambda x: {"f_sm": 0.0, "f_su": f"{x} N"}),
    "rod-play": ("mm", "Play at the rod", lambda x: {"BLK": f"{x} mm"}),
    "mass": ("kg", "Mass moved by the rod", lambda x: {"J_u": f"{x} kg"}),
    "sample-rate": ("Hz", "Sample rate", lambda x: {"sample_period": 1 / x}),
}
"""Values in a data sheet: unit, meaning, and function that derives parameters, keyed by option."""
_OF_LINEAR: Final = ("stroke", "rod-speed", "rod-friction", "rod-play", "mass")
_TOLERANCE: Final = 0.1
_POSITIVE: Final = click.FloatRange(0.0, min_open=True)


def _figure_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for name, (unit, meaning, _) in reversed(_FIGURES.items()):
        text = f"{meaning} [{unit}]."
        command = click.option(f"--{name}", type=_POSITIVE, metavar="X", help=text)(command)
    return command


def _figure(text: str) -> float | None:
    return None if text == "-" else _POSITIVE(text)


@click.command("new-actuator")
@click.option("--actuator-id", default="actuator", help="Name of the actuator in its system.")
@click.option("--serial-number", default="1", help="Serial number of the unit.")
@_figure_options
@output_option("YAML file to write", dir_okay=False)
def new_actuator(
    actuator_id: str, serial_number: str, overwrite: bool, output: Path, **options: float | None
) -> None:
    """Write an actuator file from the values in a data sheet.

    Without values, the command asks for each of them. The file lists all parameters with their
    sources.
    """
    require_free(output, [], overwrite=overwrite)
    figures = {name: options[name.replace("-", "_")] for name in _FIGURES}
    if not any(figures.values()):
        for name, (unit, meaning, _) in _FIGURES.items():
            words = f"{meaning} [{unit}]; - if unknown"
            if figures["lead"] or name not in _OF_LINEAR:
                figures[name] = click.prompt(words, "-", value_proc=_figure)
    values: dict[str, float] = {}
    sources: dict[str, str] = {}
    for name, (unit, _, follow) in _FIGURES.items():
        if (figure := figures[name]) is None:
            continue
        shafts = {entry: values[entry] for entry in ("lead", "tau") if entry in values}
        follows = follow(figure)
        in_units = in_si(shafts | follows)
        for entry in follows:
            value = float(in_units[entry])
            earlier = values.get(entry, value)
            if abs(value - earlier) > _TOLERANCE * abs(earlier):
                raise ValueError(
                    f"{name} = {figure:g} {unit} gives {entry} = {value:.4g}, but "
                    f"{sources[entry]} gives {earlier:.4g}: expected values that agree within "
                    f"{_TOLERANCE:.0%}"
                )
            values[entry] = float(f"{value:.7g}")
            sources[entry] = f"{name} {figure:g} {unit}"
    example = ActuatorDescription()
    nominal = asdict(example.parameters) | values
    if {"k_t", "I_max"} & set(values):
        values |= {"G_M": nominal["k_t"], "T_max": nominal["k_t"] * nominal["I_max"]}
        example_too = "" if {"k_t", "I_max"} <= set(sources) else ", one of them the example's"
        sources |= {"G_M": "derived: k_t", "T_max": f"derived: k_t I_max{example_too}"}
    period = values.pop("sample_period", example.sample_period)
    named = {"actuator_id": actuator_id, "serial_number": serial_number, "model": ""}
    parameters = replace(example.parameters, **values)
    description = replace(example, **named, sample_period=period, parameters=parameters)
    rate = sources.get("sample_period", "example")
    lines = [
        "# Actuator file of `ema new-actuator`, in SI units. Replace values from the example.",
        *(f"{name}: {json.dumps(text)}" for name, text in named.items()),
        f"sample_period: {description.sample_period!r}  # s, {rate}",
        "parameters:",
    ]
    unknown = [item.name for item in fields(parameters) if item.name not in sources]
    for item in fields(parameters):
        value, about = getattr(parameters, item.name), item.metadata
        source = sources.get(item.name, "example")
        lines.append(
            f"  {item.name}: {value!r}  # {about['unit']}, {source}: {about['description']}"
        )
    with complete_file(output) as partial:
        partial.write_text("\n".join([*lines, ""]), encoding="utf-8")
    for remark in description.remarks:
        click.echo(f"remark: {remark}", err=True)
    click.echo(f"{output}: from the data sheet or derived: {', '.join(sources) or 'none'}")
    click.echo(f"from the example: {', '.join(unknown)}")
