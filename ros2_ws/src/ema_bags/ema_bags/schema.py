"""Message schemas in recordings: their text, their comparison, and decoding by them without ROS.

The text is made here: rosbags generates a text without comments, which differs from the text that
rosbag2 stores.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys.base import TypesysError
from rosbags.typesys.msg import get_types_from_msg
from rosbags.typesys.store import Typestore

from ema_bags.message_type import definition, type_hash

_MOST_BEHIND = 16
_SEPARATOR = "=" * 80 + "\nMSG: "
# Type, name and default of a field. Names of constants are in capitals.
_DEFAULT = re.compile(
    r"^[ \t]*([a-z]\w*)[ \t]+([a-z]\w*)[ \t]+([^#=\s][^#=\n]*?)[ \t]*(?:#.*)?$", re.MULTILINE
)
_FIELD = re.compile(
    r"^[ \t]*([A-Za-z][\w/]*)((?:<=\d+)?(?:\[[<=\d]*\])?)[ \t]+([a-z]\w*)", re.MULTILINE
)
_PRIMITIVES = {"bool", "byte", "char", "float32", "float64", "string", "wstring"}
_PRIMITIVES |= {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


def schema_text(name: str) -> str:
    """Return the schema of an installed message type as rosbag2 stores it (``ros2msg``).

    The definition comes first, then every type that it contains, once each, depth first, those
    side by side in alphabetical order. ValueError when one of them is not installed.
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
    """Type, bounds and name of every field; types of the package itself get its name in front."""
    return [
        (kind if kind in _PRIMITIVES or "/" in kind else f"{package}/{kind}", bounds, name)
        for kind, bounds, name in _FIELD.findall(text)
    ]


def to_installed(
    name: str, recorded_text: str, recorded_hash: str
) -> Callable[[bytes], bytes] | None:
    """Return the function that upgrades recorded messages to the installed type; None if equal.

    The hash decides. Recordings from before ROS 2 Iron have none: there the fields of the
    definitions are compared. A definition that is older than the installed one lacks fields for
    which the latter has a default, which they then have.

    Parameters
    ----------
    recorded_text
        Schema in the recording; empty when it has none that is ``ros2msg``.
    recorded_hash
        Type hash in the recording; empty when it has none.

    Raises
    ------
    ValueError
        When they differ in another way, naming the fields, or the installed type cannot be found.
        The returned function raises it for a message that is malformed.
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
    words = _differences(recorded, installed) or f"{recorded_hash} there, {installed_hash} here"
    raise ValueError(f"the recorded {name} is not the installed one: {words}")


def _upgrade(
    name: str, recorded_text: str, kept: list[str], lacking: dict[str, bool | int | float | str]
) -> Callable[[bytes], bytes]:
    """Return the function that adds the missing fields of a recorded type to its messages."""
    decode, store = decoder(name, recorded_text), typestore(name, schema_text(name))
    installed = store.types[name]

    def upgrade(data: bytes) -> bytes:
        message = decode(data)
        values = {field: getattr(message, field) for field in kept}
        return bytes(store.serialize_cdr(installed(**values, **lacking), name))

    return upgrade


def _defaults(text: str) -> dict[str, bool | int | float | str]:
    """Return the default values in a definition by field; of arrays, none."""
    defaults: dict[str, bool | int | float | str] = {}
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
    """Return the function that removes the bytes after the content of an installed type's message.

    ROS reserves the padding of empty sequences, does not use it, and leaves it behind the message.
    Readers that check where a message ends refuse more than 3 bytes there.
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
    """Return the function that decodes messages of a type.

    The messages have the attributes that the definition names; sequences of numbers are arrays.
    ValueError when the definition (``ros2msg``, with all contained definitions) cannot be read; the
    function raises it for a malformed message.
    """
    store = typestore(type_name, schema)

    def decode(data: bytes) -> Any:
        # What is not a message makes the generated code of rosbags raise whatever it comes upon.
        try:
            return store.deserialize_cdr(data, type_name)
        except Exception as error:
            if "size mismatch" in str(error):
                # ROS reserves the padding of empty sequences, does not use it, and leaves it behind
                # the message; rosbags accepts 3 bytes there.
                for behind in range(4, _MOST_BEHIND + 1, 4):
                    with suppress(Exception):
                        return store.deserialize_cdr(data[:-behind], type_name)
            reason = str(error).removeprefix(f"Could not deserialize {type_name!r}: ")
            reason = reason or type(error).__name__
            raise ValueError(f"no {type_name}: {reason}") from error

    return decode


def typestore(type_name: str, schema: str) -> Typestore:
    """Return a store of a type and of all that it contains; ValueError if it cannot be read."""
    # One for each: two recordings may have different versions of a type.
    store = Typestore()
    try:
        # Definitions that were written on Windows end their lines by CR LF.
        store.register(get_types_from_msg(schema.replace("\r\n", "\n"), type_name))
        store.get_msgdef(type_name)
    except (TypesysError, SerdeError, LookupError) as error:
        raise ValueError(f"the definition of {type_name} cannot be read: {error}") from error
    except RecursionError as error:
        reason = "it is nested too deeply, or contains itself"
        raise ValueError(f"the definition of {type_name} cannot be read: {reason}") from error
    return store


def _differences(recorded: dict[str, list[str]], installed: dict[str, list[str]]) -> str:
    differences = []
    for short in dict.fromkeys([*installed, *recorded]):
        there, here = recorded.get(short, []), installed.get(short, [])
        if there != here:
            only_there = ", ".join(field for field in there if field not in here)
            only_here = ", ".join(field for field in here if field not in there)
            differences.append(
                f"{short} has [{only_there}] in the recording where it has [{only_here}] here"
                if only_there or only_here
                else f"{short} has the same fields in another order"
            )
    return "; ".join(differences)


def _field_lists(name: str, text: str) -> dict[str, list[str]]:
    """Fields of every definition in a schema, as text, by the definition's short name."""
    package, _, short = name.split("/")
    named = f"{_SEPARATOR}{package}/{short}\n{text}".replace("\r\n", "\n").split(_SEPARATOR)[1:]
    lists = {}
    for block in named:
        head, _, body = block.partition("\n")
        fields = _fields(body, head.partition("/")[0])
        short_name = head.strip().replace("/msg/", "/")
        lists[short_name] = [f"{kind}{bounds} {field}" for kind, bounds, field in fields]
    return lists
