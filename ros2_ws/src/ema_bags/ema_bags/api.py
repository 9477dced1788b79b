"""Recordings as a library: messages and telemetry of a bag."""

from collections.abc import Iterator
from pathlib import Path

from ema_bags.reader import Bag
from ema_bags.telemetry import read_telemetry as find_telemetry
from ema_core.telemetry import Telemetry

__all__ = ["Bag", "read_telemetry"]


def read_telemetry(
    path: str | Path, *, topic: str | None = None, actuator_id: str | None = None
) -> Iterator[Telemetry]:
    """Read the telemetry of one actuator block by block, without malformed blocks.

    Parameters
    ----------
    path
        The recording: an ``.mcap`` file, or a folder as ``ros2 bag record`` makes it.
    topic, actuator_id
        Selection of the telemetry; needed if there are several actuators or topics.

    Raises
    ------
    ValueError
        When the recording cannot be read, or has no such telemetry.
    OSError
        When it cannot be opened.
    """
    for _, item in find_telemetry(Bag(path), topic, actuator_id).items():
        if isinstance(item, Telemetry):
            yield item
