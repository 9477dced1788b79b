# SPDX-License-Identifier: Apache-2.0
"""Recorded messages as decoded by ROS, to compare with the messages sent."""

import importlib
from collections.abc import Iterable
from typing import Any

from rclpy.serialization import deserialize_message

from ema_bags.reader import Bag
from ema_bags.recording import Recorded


def ros_messages(bag: Bag, topics: Iterable[str] | None = None) -> list[Recorded]:
    return [
        item._replace(message=deserialize_message(item.message, _message_class(item.type_name)))
        for item in bag.raw_messages(topics)
    ]


def _message_class(name: str) -> Any:
    package, kind, short = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), short)
