# SPDX-License-Identifier: Apache-2.0
"""Message schemas of recordings: generation, comparison, and decoding without ROS.

Schemas are generated here, because rosbags omits comments: its schemas differ from the schemas
stored by rosbag2.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys.base import TypesysError
from rosbags.typesys.msg import get_types_from_msg
from rosbags.typesys.store import Typestore

from ema_bags.message_type import definition, type_hash

_MOST_PADDING = 16
_SEPARATOR = "=" * 80 + "\nMSG: "
# Type, name and default of a field; names of constants are in capitals.
_DEFAULT = re.compile(
    r"^[ \t]*([a-z]\w*)[ \t]+([a-z]\w*)[ \t]+([^#=\s][^#=\n]*?)[ \t]*(?:#.*)?$", re.MULTILINE
)
_ARRAY = re.compile(r"^[ \t]*float64\[\][ \t]+([a-z]\w*)", re.MULTILINE)
_FIELD = re.compile(
    r"^[ \t]*([A-Za-z][\w/]*)((?:<=\d+)?(?:\[[<=\d]*\])?)[ \t]+([a-z]\w*)", re.MULTILINE
)
_PRIMITIVES = {"bool", "byte", "char", "float32", "float64", "string", "wstring"}
_PRIMITIVES |= {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


def schema_text(name: str) -> str:
    """Return the schema of an installed message type in the format of rosbag2 (``ros2msg``).

    The definition comes first, then every contained type once, depth first and in alphabetical
    order.

    Raises
    ------
    ValueError
        If a type is not installed.
    """
    return "\n".join(_definitions(name, set()))


def _definitions(name: str, seen: set[str]) -> Iterator[str]:
    text = definition(name)
    package, _, short = name.split("/")
    yield f"{_SEPARATOR}{package}/{short}\n{text}" if seen else text
    seen.add(name)
    types = {field_type for field_type, _, _ in _fields(text, package)}
    for contained in sorted(types - _PRIMITIVES):
        contained_name = contained.replace("/", "/msg/")
        if contained_name not in seen:
            yield from _definitions(contained_name, seen)


def _fields(text: str, package: str) -> list[tuple[str, str, str]]:
    """Return type, bounds and name of every field; types always include their package."""
    return [
        (kind if kind in _PRIMITIVES or "/" in kind else f"{package}/{kind}", bounds, name)
        for kind, bounds, name in _FIELD.findall(text)
    ]


def to_installed(
    name: str, recorded_text: str, recorded_hash: str
) -> Callable[[bytes], bytes] | None:
    """Return a function that upgrades recorded messages to the installed type; None if equal.

    The hashes are compared. Recordings older than ROS 2 Iron have no hash: the fields of the
    definitions are compared instead. If the recorded definition only lacks fields with a default
    in the installed definition, the upgrade adds them with their defaults; the default of an
    unbounded ``float64`` array is empty.

    Parameters
    ----------
    name
        Name of the type.
    recorded_text
        ``ros2msg`` schema in the recording; empty if missing.
    recorded_hash
        Type hash in the recording; empty if missing.

    Raises
    ------
    ValueError
        If the types differ in any other way, naming the fields, or the type is not installed. The
        returned function raises ValueError for a malformed message.
    """
    installed_hash = type_hash(name)
    if recorded_hash == installed_hash:
        return None
    recorded, installed = _field_lists(name, recorded_text), _field_lists(name, schema_text(name))
    if recorded == installed and not recorded_hash:
        return None
    short_name = name.replace("/msg/", "/")
    older, newer = recorded.get(short_name, []), installed[short_name]
    defaults = _defaults(definition(name))
    lacking = {item.rpartition(" ")[2] for item in newer if item not in older}
    if (
        lacking
        and lacking <= defaults.keys()
        and recorded | {short_name: newer} == installed
        and [item for item in newer if item in older] == older
    ):
        kept = [item.rpartition(" ")[2] for item in older]
        return _upgrade(name, recorded_text, kept, {item: defaults[item] for item in lacking})
    difference = (
        _differences(recorded, installed) or f"recorded {recorded_hash}, installed {installed_hash}"
    )
    raise ValueError(f"the recorded {name} differs from the installed version: {difference}")


def _upgrade(
    name: str, recorded_text: str, kept: list[str], lacking: dict[str, Any]
) -> Callable[[bytes], bytes]:
    """Return a function that adds the missing fields of a recorded type to its messages."""
    decode, store = decoder(name, recorded_text), typestore(name, schema_text(name))
    installed = store.types[name]

    def upgrade(data: bytes) -> bytes:
        message = decode(data)
        values = {field: getattr(message, field) for field in kept}
        return bytes(store.serialize_cdr(installed(**values, **lacking), name))

    return upgrade


def _defaults(text: str) -> dict[str, Any]:
    """Return the default value of each field of a definition that has one.

    The default of a ``float64[]`` is an empty array; other arrays have none.
    """
    defaults: dict[str, Any] = {field: np.empty(0) for field in _ARRAY.findall(text)}
    for kind, field, value in _DEFAULT.findall(text):
        if kind == "bool":
            defaults[field] = value.lower() in ("true", "1")
        elif kind in ("string", "wstring"):
            defaults[field] = value.strip("\"'")
        elif kind in _PRIMITIVES:
            defaults[field] = float(value) if kind.startswith("float") else int(value)
    return defaults


@cache
def trimmer(name: str) -> Callable[[bytes], bytes]:
    """Return a function that removes the bytes after the content of a message of a type.

    ROS reserves the padding of empty sequences, does not use it, and leaves it after the message.
    Readers that check the end of a message refuse more than 3 such bytes.
    """
    store = typestore(name, schema_text(name))
    definition = store.get_msgdef(name)

    def trim(data: bytes) -> bytes:
        try:
            _, end = definition.deserialize_cdr_le(data[4:], 0, definition.cls, store)
        except Exception:
            return data
        return data[: 4 + end] if data[:2] == b"\x00\x01" else data

    return trim


@cache
def decoder(type_name: str, schema: str) -> Callable[[bytes], Any]:
    """Return a function that decodes messages of a type.

    Decoded messages have the fields of the definition as attributes; sequences of numbers are
    arrays.

    Parameters
    ----------
    type_name
        Name of the type.
    schema
        Definition of the type (``ros2msg``), with all contained definitions.

    Raises
    ------
    ValueError
        If the definition cannot be read. The returned function raises ValueError for a malformed
        message.
    """
    store = typestore(type_name, schema)

    def decode(data: bytes) -> Any:
        # The generated code of rosbags raises various errors for malformed messages.
        try:
            return store.deserialize_cdr(data, type_name)
        except Exception as error:
            if "size mismatch" in str(error):
                # ROS leaves unused padding after the message; rosbags accepts 3 bytes of it.
                for padding in range(4, _MOST_PADDING + 1, 4):
                    with suppress(Exception):
                        return store.deserialize_cdr(data[:-padding], type_name)
            reason = str(error).removeprefix(f"Could not deserialize {type_name!r}: ")
            reason = reason or type(error).__name__
            raise ValueError(f"no {type_name}: {reason}") from error

    return decode


def typestore(type_name: str, schema: str) -> Typestore:
    """Return a store of a type and all contained types; ValueError if they cannot be read."""
    # A separate store: two recordings may have different versions of a type.
    store = Typestore()
    try:
        # Definitions written on Windows have CR LF line ends.
        store.register(get_types_from_msg(schema.replace("\r\n", "\n"), type_name))
        store.get_msgdef(type_name)
    except (TypesysError, SerdeError, LookupError) as error:
        raise ValueError(f"the definition of {type_name} cannot be read: {error}") from error
    except RecursionError as error:
        reason = "it is nested too deeply or contains itself"
        raise ValueError(f"the definition of {type_name} cannot be read: {reason}") from error
    return store


def _differences(recorded: dict[str, list[str]], installed: dict[str, list[str]]) -> str:
    differences = []
    for short in dict.fromkeys([*installed, *recorded]):
        recorded_fields, installed_fields = recorded.get(short, []), installed.get(short, [])
        if recorded_fields != installed_fields:
            only_there = ", ".join(
                field for field in recorded_fields if field not in installed_fields
            )
            only_here = ", ".join(
                field for field in installed_fields if field not in recorded_fields
            )
            differences.append(
                f"{short} has [{only_there}] in the recording, but [{only_here}] in the "
                "installed version"
                if only_there or only_here
                else f"{short} has the same fields in another order"
            )
    return "; ".join(differences)


def _field_lists(name: str, text: str) -> dict[str, list[str]]:
    """Return the fields of every definition in a schema as strings, by short name."""
    package, _, short = name.split("/")
    named = f"{_SEPARATOR}{package}/{short}\n{text}".replace("\r\n", "\n").split(_SEPARATOR)[1:]
    lists = {}
    for block in named:
        head, _, body = block.partition("\n")
        fields = _fields(body, head.partition("/")[0])
        short_name = head.strip().replace("/msg/", "/")
        lists[short_name] = [f"{kind}{bounds} {field}" for kind, bounds, field in fields]
    return lists
