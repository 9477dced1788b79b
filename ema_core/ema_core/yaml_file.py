# SPDX-License-Identifier: Apache-2.0
"""Reading of YAML files of bounded size, without duplicate keys or huge numbers."""

import re
from itertools import chain
from pathlib import Path
from typing import Any, Final

import yaml

from ema_core.expecting import require_type
from ema_core.files import read_regular_file

MOST_BYTES: Final = 64_000_000
"""Largest size of a file that is read [bytes]."""

_MOST_VALUES: Final = 5_000_000
_LARGEST: Final = 2**63
_DEEPEST: Final = 200
_Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_Base):
    """YAML loader that refuses duplicate keys, and integers of more than 64 bits."""

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        seen = set()
        for key, _ in node.value:
            if key.value == "<<" or not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{key.value} is repeated", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)

    def construct_bounded(self, node: Any) -> int:
        """Return an integer of at most 64 bits."""
        digits = len(node.value)
        value = self.construct_yaml_int(node) if digits < 100 else _LARGEST
        if not -_LARGEST <= value < _LARGEST:
            text = node.value if digits < 30 else f"a number of {digits} digits"
            raise yaml.constructor.ConstructorError(
                None, None, f"{text}: expected at most 64 bits", node.start_mark
            )
        return value


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_bounded)


def load_yaml(path: str | Path, most_bytes: int | None = None) -> Any:
    """Return the content of a YAML file as plain values.

    Parameters
    ----------
    path
        The file.
    most_bytes
        Largest permitted size of the file [bytes]; None for ``MOST_BYTES``. Parsing takes about
        1 s per MB.

    Raises
    ------
    ValueError
        If the path has a wrong type, or the file is not regular, too large or not YAML; the message
        names the file and the reason.
    OSError
        If the file cannot be read.
    """
    require_type("path", path, (str, Path))
    try:
        return parse_yaml(
            read_regular_file(Path(path), MOST_BYTES if most_bytes is None else most_bytes)
        )
    except YamlError as error:
        raise ValueError(f"{path} is not a YAML file: {error}") from error


class YamlError(ValueError):
    """The content is not YAML, or uses features of YAML that are refused."""


def parse_yaml(content: bytes) -> Any:
    """Return the content of a YAML document as plain values.

    Raises
    ------
    YamlError
        If the content is not YAML, is nested too deeply, or expands to too many values.
    """
    try:
        if _is_nested_deeply(content):
            raise ValueError("it is nested too deeply")
        loaded = yaml.load(content.decode(), Loader=_Loader)
        if _holds_too_much(loaded):
            raise ValueError(f"it expands to more than {_MOST_VALUES:,} values")
    except (yaml.YAMLError, ValueError) as error:
        raise YamlError(str(error).replace('in "<unicode string>", ', "at ")) from error
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:
        raise YamlError(f"a tag does not fit its value: {error!r}") from error
    return loaded


def _is_nested_deeply(content: bytes) -> bool:
    """Return whether deep nesting might overflow the loader's stack and kill the process."""
    depth = deepest = 0
    for bracket in re.finditer(rb"[\[\]{}]", content):
        depth += 1 if bracket[0] in b"[{" else -1
        deepest = max(deepest, depth)
    lines = content.splitlines()
    indented = max((len(line) - len(line.lstrip(b" -?:")) for line in lines), default=0)
    return max(deepest, indented) > _DEEPEST


def _holds_too_much(content: Any) -> bool:
    """Return whether there are too many values; each reference to a value counts as a value."""
    count, level = 0, [content]
    while level:
        parts = [
            value.values() if isinstance(value, dict) else value
            for value in level
            if isinstance(value, dict | list)
        ]
        count += sum(map(len, parts))
        if count > _MOST_VALUES:
            return True
        level = list(chain.from_iterable(parts))
    return False
