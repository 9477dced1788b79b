# SPDX-License-Identifier: Apache-2.0
"""Classes, definitions and hashes of message types by their names in recordings.

Hashes are read from the installed files: rosbags computes equal hashes, but needs the definitions
of all contained types first.
"""

import importlib
import json
import os
from functools import lru_cache
from pathlib import Path
from typing import Any


def type_name(message_class: type) -> str:
    """Return the name of a message class, such as ``std_msgs/msg/Header``.

    Raises
    ------
    ValueError
        If the class is not a message class.
    """
    if not hasattr(message_class, "get_fields_and_field_types"):
        raise ValueError(f"{message_class!r}: expected the class of a ROS message")
    package, kind = message_class.__module__.split(".")[:2]
    return f"{package}/{kind}/{message_class.__name__}"


def message_class(name: str) -> Any:
    """Return the class of a message type; ValueError if it is not installed."""
    package, kind, short = _parts(name)
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), short)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"message type {name} is not installed: {error}") from error


def definition(name: str) -> str:
    """Return the text of the ``.msg`` file of a message type; ValueError if it is not installed."""
    return _shared_file(name, ".msg").read_bytes().decode()  # keeps line ends unchanged


def type_hash(name: str) -> str:
    """Return the hash of a message type, ``RIHS01_...``; ValueError if it is not installed."""
    return _hashes(_shared_file(name, ".json"))[name]


@lru_cache(maxsize=1024)
def _hashes(path: Path) -> dict[str, str]:
    description = json.loads(path.read_text(encoding="utf-8"))
    return {item["type_name"]: item["hash_string"] for item in description["type_hashes"]}


def _parts(name: str) -> tuple[str, str, str]:
    parts = name.split("/")
    if len(parts) != 3 or not all(part.isidentifier() for part in parts):
        raise ValueError(f"message type {name!r}: expected a name such as 'std_msgs/msg/Header'")
    return parts[0], parts[1], parts[2]


def is_installed(name: str) -> bool:
    """Return whether a message type is installed; False without ROS."""
    try:
        _shared_file(name, ".json")
    except ValueError:
        return False
    return True


def _shared_file(name: str, suffix: str) -> Path:
    return _installed_file(name, suffix, os.environ.get("AMENT_PREFIX_PATH", ""))


# For a short bag, reading the disk again for each topic took 5 % of the estimation time.
@lru_cache(maxsize=1024)
def _installed_file(name: str, suffix: str, prefixes: str) -> Path:
    package, kind, short = _parts(name)
    # The folders of the ament index, so that reading needs no ROS.
    shares = (Path(prefix, "share", package) for prefix in prefixes.split(os.pathsep) if prefix)
    share = next((path for path in shares if path.is_dir()), None)
    if share is None:
        raise ValueError(f"message type {name} is not installed: no {package}")
    path = share / kind / (short + suffix)
    if not path.exists():
        raise ValueError(f"message type {name} is not installed: no {path}")
    return path
