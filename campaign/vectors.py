"""MCAP files by the specification: valid ones are read, of malformed ones the defect is named.

They are made here (`mcap_form`): with all combinations of features that the specification allows,
of the contents by which MCAP's own project tests readers, and of drawn ones. MCAP's own library
reads the valid ones as well, so that the two agree on what a valid file is.
"""

from collections.abc import Iterator
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, Final

import malformed
import numpy as np
from mcap.reader import NonSeekingReader
from mcap_form import EXAMPLES, Channel, Content, Message, Schema, mcap_file
from part import Case, Part

from ema_recording.reader import Bag

_VECTORS: Final = 1000
_COMPRESSIONS: Final = ("", "zstd", "lz4")


def run(case: Case) -> None:
    """Read vectors: in an even case valid ones, in an odd one malformed ones."""
    if case.number == 0:
        for name, content in EXAMPLES.items():
            for features in content.features():
                _read_valid(
                    case, f"{name} {_words(features)}", content, mcap_file(content, features)
                )
    elif case.number % 2 == 0:
        for number in range(case.steps or _VECTORS):
            _read_drawn(case, number)
    else:
        for what, data, complete in islice(_malformed(case), case.steps or _VECTORS):
            _read_malformed(case, what, data, complete)


def _words(features: frozenset[str]) -> str:
    return "-".join(sorted(features)) or "plain"


def drawn_content(rng: np.random.Generator) -> Content:
    """Return schemas, channels and messages without order in time."""
    schemas = [
        Schema(n + 1, f"a/msg/B{n}", "ros2msg", rng.bytes(int(rng.integers(0, 30))))
        for n in range(int(rng.integers(1, 4)))
    ]
    channels = [
        Channel(n, int(rng.integers(0, len(schemas) + 1)), f"/topic_{n}", "cdr", {"a": "b"})
        for n in range(int(rng.integers(1, 5)))
    ]
    times = rng.integers(0, 50, int(rng.integers(1, 40)))
    messages = [
        Message(int(rng.integers(0, len(channels))), n, int(t), int(t), rng.bytes(int(t)))
        for n, t in enumerate(times)
    ]
    return Content(schemas, channels, messages, profile="ros2")


def _read_drawn(case: Case, number: int) -> None:
    rng = case.rng(number)
    content = drawn_content(rng)
    known = sorted(content.features(), key=sorted)
    features = known[int(rng.integers(len(known)))]
    compression, size = _COMPRESSIONS[int(rng.integers(3))], int(rng.integers(0, 8))
    data = mcap_file(content, features, compression, size)
    what = f"vector {number}, {_words(features)} {compression} {size}"
    _read_valid(case, what, content, data)


def _read_valid(case: Case, what: str, content: Content, data: bytes) -> None:
    case.count("valid read")
    wanted = _told(content)
    found, words = read_all(case.folder / "vector.mcap", data)
    if words or found != wanted:
        case.fail(f"{what}: valid, read as {words or 'whole'} with {found} for {wanted}"[:500])
    reader = NonSeekingReader(BytesIO(data), validate_crcs=True)
    theirs = [
        (channel.topic, message.log_time, message.data)
        for _, channel, message in reader.iter_messages(log_time_order=True)
    ]
    if theirs != wanted:
        case.fail(f"{what}: mcap's own reader finds {theirs} for {wanted}"[:500])


def _told(content: Content) -> list[tuple[str, int, bytes]]:
    topics = {channel.id: channel.topic for channel in content.channels}
    ordered = sorted(content.messages, key=lambda message: message.log_time)
    return [(topics[item.channel_id], item.log_time, item.data) for item in ordered]


def read_all(path: Path, data: bytes) -> tuple[list[tuple[str, int, bytes]], str]:
    """Read all messages of a file; return them, and what is wrong with it, in words."""
    path.write_bytes(data)
    try:
        bag = Bag(path)
        found = [(item.topic, item.log_time_ns, item.message) for item in bag.raw_messages()]
    except ValueError as error:
        return [], f"refused: {error}"
    return found, bag.damage


def _malformed(case: Case) -> Iterator[tuple[str, bytes, list[Any]]]:
    number = 0
    while True:
        rng = case.rng(number)
        content = drawn_content(rng)
        for what, data in malformed.files(content, rng):
            yield f"vector {number}, {what}", data, _told(content)
        number += 1


def _read_malformed(case: Case, what: str, data: bytes, complete: list[Any]) -> None:
    """The defect is named, and nothing is read that was not written."""
    kind = what.partition(", ")[2]
    try:
        found, words = read_all(case.folder / "vector.mcap", data)
    except Exception as error:
        case.fail(f"{what}: raised {error!r}")
        return
    case.count("malformed refused" if words.startswith("refused") else "malformed read in part")
    if not words:
        case.fail(f"{what}: read without a word, {len(found)} of {len(complete)} messages")
    elif kind not in malformed.MAKES_OTHERS:
        left = list(complete)
        for item in found:
            if item not in left:
                case.fail(f"{what}: {words}: read what was not written: {item}"[:500])
                return
            left.remove(item)


PART: Final = Part(
    name="vectors",
    summary="valid MCAP files are read whole, defects of malformed ones named",
    run=run,
    usual_s=20.0,
    limit_s=300.0,
    share=0.2,
    most_cases=20,
)
