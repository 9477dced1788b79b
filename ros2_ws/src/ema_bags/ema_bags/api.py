# SPDX-License-Identifier: Apache-2.0
"""Library interface for recordings: messages and telemetry of a bag."""

from collections.abc import Iterator
from pathlib import Path

from ema_bags.reader import Bag
from ema_bags.telemetry import read_telemetry as find_telemetry
from ema_core.telemetry import Telemetry

__all__ = ["Bag", "read_telemetry"]


def read_telemetry(
    path: str | Path, *, topic: str | None = None, actuator_id: str | None = None
) -> Iterator[Telemetry]:
    """Yield the telemetry of one actuator block by block; malformed blocks are skipped.

    Parameters
    ----------
    path
        The recording: an ``.mcap`` file, or a folder written by ``ros2 bag record``.
    topic, actuator_id
        Selection of the telemetry; required if there are several actuators or topics.

    Raises
    ------
    ValueError
        If the recording cannot be read, or has no such telemetry.
    OSError
        If the recording cannot be opened.
    """
    for _, item in find_telemetry(Bag(path), topic, actuator_id).items():
        if isinstance(item, Telemetry):
            yield item
