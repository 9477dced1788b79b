# SPDX-License-Identifier: Apache-2.0
"""Settings of commands by node parameters: ``-p NAME=VALUE`` and ``--params FILE``."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from ema_cli.options import values_of_options
from ema_core.faults import FAULT_NAMES
from ema_core.settings_parameters import (
    SettingsParameter,
    field_values,
    parameters_of,
    refuse_old_names,
)
from ema_core.wording import as_identifier, unknown_name

Settings = TypeVar("Settings")
Command = Callable[..., None]

_SECTION: Final = "ros__parameters"


@dataclass(frozen=True)
class Parameters:
    """Specified parameter values, keyed by name, including values that the command does not use."""

    values: Mapping[str, Any]

    def with_options(self, **options: Any) -> "Parameters":
        """Return the parameters overridden by option values; None is ignored."""
        return Parameters({**self.values, **{k: v for k, v in options.items() if v is not None}})

    def over(self, settings: Settings, prefix: str = "") -> Settings:
        """Return settings with the specified parameters replaced.

        ``prefix`` is the prefix of their parameter names.

        Raises
        ------
        click.UsageError
            If a value is out of range; the message names parameter, value, unit and range.
        """
        try:
            values = field_values(settings, self.values, prefix)
        except ValueError as error:
            raise click.UsageError(str(error)) from error
        try:
            return replace(settings, **values) if values else settings  # pyright: ignore
        except ValueError as error:
            raise click.UsageError(f"{prefix}{error}") from error

    def path(self, name: str) -> Path | None:
        """Return a parameter as a path, or None if it is not specified."""
        text = self.values.get(name)
        return Path(text).expanduser() if text else None


def settings_options(
    kind: type[Any], node: str = "monitor", more: Iterable[Callable[[Command], Command]] = ()
) -> Callable[[Command], Command]:
    """Return a decorator that adds options to a command, which receives them as ``options``.

    Parameters
    ----------
    kind
        Class with the click options in ``OPTIONS``, dataclasses and prefixes of the parameters in
        ``SECTIONS``, and a class method ``of(parameters, **options)`` that creates the argument.
    node
        Name of the node with these parameters.
    more
        Further options.
    """
    decorators = [
        *kind.OPTIONS,
        *more,
        click.option(
            "-p",
            "--param",
            "assignments",
            multiple=True,
            metavar="NAME=VALUE",
            help=f"Parameter of the {node} (docs/parameters.md).",
        ),
        click.option(
            "--params",
            "parameter_file",
            type=click.Path(path_type=Path, exists=True, dir_okay=False),
            help="Parameter file; options take precedence.",
        ),
    ]

    def add(command: Command) -> Command:
        arguments = signature(command).parameters
        parameters = _of_dataclasses(kind.SECTIONS)
        names = [item.name for item in parameters]

        @wraps(command)
        def with_options(
            *, assignments: tuple[str, ...], parameter_file: Path | None, **values_by_name: Any
        ) -> None:
            shared = {
                name: values_by_name.pop(name)
                for name in list(values_by_name)
                if name not in arguments
            }
            values = dict(parameters_in(parameter_file, node)) if parameter_file else {}
            with values_of_options():
                refuse_old_names(parameters, values)
                values |= _assigned(assignments, parameters)
            # An option with the name of a parameter sets the parameter.
            for name in (name for name in names if name in shared):
                if (value := shared.pop(name)) is not None:
                    values[name] = str(value) if isinstance(value, Path) else value
            built = kind.of(Parameters(values), **shared)
            command(options=built, **values_by_name)

        vars(with_options)["parameters"] = names
        decorated: Command = with_options
        for option in reversed(decorators):
            decorated = option(decorated)
        return decorated

    return add


def names_of(sections: Iterable[tuple[Any, str]]) -> list[str]:
    """Return the parameter names, with prefix, for pairs of dataclass and prefix."""
    return [item.name for item in _of_dataclasses(sections)]


def _of_dataclasses(sections: Iterable[tuple[Any, str]]) -> list[SettingsParameter]:
    return [entry for item, prefix in sections for entry in parameters_of(item, prefix)]


def _assigned(
    assignments: Iterable[str], parameters: Sequence[SettingsParameter]
) -> dict[str, Any]:
    """Parse assignments ``NAME=VALUE``, or ``NAME:=VALUE`` as in ROS, with the value in YAML.

    Raises
    ------
    ValueError
        If an assignment is malformed or repeated, or its name is unknown.
    """
    names = [item.name for item in parameters]
    assigned: dict[str, Any] = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        name = name.removesuffix(":").strip()
        if not equals:
            raise ValueError(f"-p {text!r}: expected NAME=VALUE")
        refuse_old_names(parameters, (name,))
        if name not in names:
            raise ValueError(f"-p: {unknown_name('parameter', name, names)}")
        if name in assigned:
            raise ValueError(f"-p {name}: specified more than once")
        assigned[name] = value_of(value)
    return assigned


def instead_of(option: str, command: click.Command) -> str:
    """Return a suggestion for an unknown option, to append to an error, or "" if there is none."""
    name = as_identifier(option.lstrip("-")).removeprefix("no_")
    has = {word for item in command.params for word in item.opts}
    if (same := f"--{name.replace('_', '-')}") in has:
        return f": did you mean {same}?"
    if "-p" not in has:
        return ""
    if name in FAULT_NAMES and (options := {"--fault", "--limit"} & has):
        return f": use {min(options)} {name}=VALUE"
    parameters = vars(command.callback).get("parameters", ())
    if any(item.startswith(f"{name}.") for item in parameters):
        names = [f"{name}.NAME"]
    else:
        names = [item for item in parameters if item == name or item.startswith(f"{name}_")]
        names = names or [item for item in parameters if item.endswith(f".{name}")]
    return f": use -p {names[0]}=VALUE (docs/parameters.md)" if names else ""


def value_of(text: str) -> Any:
    """Parse a YAML value; return the text itself if it is not valid YAML."""
    import yaml  # imported only if there is a value

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return text


def parameters_in(path: Path, node: str) -> Iterator[tuple[str, Any]]:
    """Yield name and value of a node's parameters in a parameter file, from any namespace.

    Raises
    ------
    ValueError
        If the file is not YAML.
    """
    from ema_core.yaml_file import load_yaml

    try:
        content = load_yaml(path)
    except ValueError as error:
        raise ValueError(f"{path}: expected a parameter file: {error}") from error
    yield from _of_sections(content, "", node)


def _of_sections(content: Any, place: str, node: str) -> Iterator[tuple[str, Any]]:
    for key, value in content.items() if isinstance(content, dict) else ():
        if key != _SECTION:
            yield from _of_sections(value, str(key).rpartition("/")[2], node)
        elif place in (node, "**"):
            yield from _flat(value, "")


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flat(item, f"{name}.{key}" if name else str(key))
    else:
        yield name, value
