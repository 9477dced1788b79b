# SPDX-License-Identifier: Apache-2.0
"""Recording while the disk is full or fails, or while another program removes the bag."""

import errno
import itertools
import random
import shutil
from pathlib import Path
from typing import Any

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from ema_bags import bag_file, writer
from ema_bags.reader import Bag
from ema_bags.writer import BagWriter
from ema_interfaces.msg import ActuatorDescription
from ema_ros import topics

from ..waiting import wait_for

QOS = QoSProfile(depth=10)


class Disk:
    """A disk with limited room, which may break off every write."""

    def __init__(self) -> None:
        self.room: float = float("inf")
        self.error = errno.ENOSPC
        self.rng = random.Random(31)

    def open(self, path: Path) -> Any:
        if self.room <= 0:
            raise OSError(self.error, "no room", str(path))
        return _File(self, path.open("x+b", buffering=0))


class _File:
    def __init__(self, disk: Disk, file: Any) -> None:
        self._disk, self._file = disk, file

    def write(self, data: bytes) -> int:
        disk = self._disk
        if disk.room <= 0:
            raise OSError(disk.error, "no room")
        count = min(
            len(data), max(1, round(disk.rng.random() * len(data))), int(min(disk.room, 1e9))
        )
        disk.room -= count
        return self._file.write(data[:count])

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk()
    init = bag_file.HeldFile.__init__

    def on_disk(self: bag_file.HeldFile, path: Path) -> None:
        file = disk.open(path)
        path_there = path.with_suffix(".made")
        init(self, path_there)
        self._file.close()
        path_there.unlink()
        self._file = file

    monkeypatch.setattr(bag_file.HeldFile, "__init__", on_disk)
    monkeypatch.setattr(writer, "_MOST_WAITING", 30_000)
    return disk


def write(bag: BagWriter, numbers: range) -> list[bool]:
    return [
        bag.write_serialized("/t", data(number), number * 10**6, number * 10**6)
        for number in numbers
    ]


def data(number: int) -> bytes:
    text = f"{number} " + str(random.Random(number).getrandbits(1000))
    size = len(text) + 1
    return b"\x00\x01\x00\x00" + size.to_bytes(4, "little") + text.encode() + b"\x00"


def numbers_in(bag: Bag) -> list[int]:
    return [int(item.message.data.partition(" ")[0]) for item in bag.messages()]


@pytest.mark.parametrize(("name", "error"), [("flight", errno.ENOSPC), ("flight.mcap", errno.EIO)])
def test_recording_continues_when_there_is_room_again(
    disk: Disk, tmp_path: Path, name: str, error: int
):
    disk.error = error
    path = tmp_path / name
    with BagWriter(path, chunk_bytes=10_000, flush_s=0.02, waits_for_room=True) as bag:
        bag.add_topic("/t", String, QOS)
        assert all(write(bag, range(100)))
        disk.room = 5000  # in the middle of a write
        kept = write(bag, range(100, 1000))
        assert bag.failure is not None
        assert bag.failure.errno == error
        assert not all(kept)
        assert bag.gaps[0].messages == kept.count(False)
        assert bag.waiting < 64 * 1024 + 30_000
        disk.room = float("inf")
        wait_for(lambda: bag.failure is None, "the room to be noticed")
        assert all(write(bag, range(1000, 1100)))
    recording = Bag(path)
    assert numbers_in(recording) == [
        *range(100),
        *itertools.compress(range(100, 1000), kept),
        *range(1000, 1100),
    ]
    assert recording.damage == ""
    [remark] = recording.remarks
    assert remark.startswith(f"gap: {kept.count(False)} messages from 0.")
    assert f"[Errno {error}] no room" in remark
    assert sum(recording.readable_counts().values()) == len(numbers_in(recording))


def test_short_lack_of_room_loses_nothing(disk: Disk, tmp_path: Path):
    with BagWriter(tmp_path / "flight.mcap", flush_s=0.02, waits_for_room=True) as bag:
        bag.add_topic("/t", String, QOS)
        disk.room = 0
        assert all(write(bag, range(50)))
        wait_for(lambda: bag.failure is not None, "the lack of room to be noticed")
        disk.room = float("inf")
    recording = Bag(tmp_path / "flight.mcap")
    assert numbers_in(recording) == list(range(50))
    assert (recording.remarks, bag.gaps) == ([], [])


def test_next_file_waits_for_room(disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A split is due while no file can be created or closed: recording stays in this file."""
    monkeypatch.setattr(writer, "_MOST_WAITING", 10**6)
    with BagWriter(
        tmp_path / "flight", flush_s=0.02, max_duration_s=0.1, waits_for_room=True
    ) as bag:
        bag.add_topic("/t", String, QOS)
        write(bag, range(150))
        disk.room = 0
        write(bag, range(150, 500))
        assert bag.file_path.name == "flight_1.mcap"
        disk.room = float("inf")
        bag.flush()
        write(bag, range(500, 700))
        assert bag.file_path.name in ("flight_2.mcap", "flight_3.mcap", "flight_4.mcap")
    recording = Bag(tmp_path / "flight")
    assert numbers_in(recording) == list(range(700))
    assert recording.remarks == []
    names = sorted(path.name for path in (tmp_path / "flight").glob("*.mcap"))
    assert names == [f"flight_{number}.mcap" for number in range(len(names))]


def test_recorder_killed_on_a_full_disk_keeps_what_was_written(disk: Disk, tmp_path: Path):
    bag = BagWriter(tmp_path / "flight.mcap", flush_s=0.02, waits_for_room=True)
    bag.add_topic("/t", String, QOS)
    write(bag, range(100))
    bag.flush()
    disk.room = 3000
    write(bag, range(100, 200))
    wait_for(lambda: bag.failure is not None, "the lack of room to be noticed")
    read = numbers_in(Bag(tmp_path / "flight.mcap"))
    assert read[:100] == list(range(100))
    with pytest.raises(OSError, match="no room"):
        bag.close()
    bag.close()


def test_full_disk_without_patience_is_an_error(disk: Disk, tmp_path: Path):
    bag = BagWriter(tmp_path / "flight.mcap")
    bag.add_topic("/t", String, QOS)
    disk.room = 0
    with pytest.raises(OSError, match="no room"):
        write(bag, range(10_000))
    with pytest.raises(OSError, match="no room"):
        bag.close()


@pytest.mark.parametrize("name", ["one.mcap", "folder"])
def test_recording_of_a_bag_that_is_removed_continues_in_a_new_file(tmp_path: Path, name: str):
    path = tmp_path / "bags" / name
    with BagWriter(path, flush_s=0.1, waits_for_room=True) as bag:
        bag.add_topic("/words", String, QOS)
        bag.add_topic("/ema/actuator_description", ActuatorDescription, topics.LATCHED)
        bag.write("/ema/actuator_description", ActuatorDescription(actuator_id="flap"), 5)
        for number in range(3):
            bag.write("/words", String(data="before"), 10 + number)
        bag.flush()
        shutil.rmtree(path.parent)
        wait_for(lambda: bag.removed, "the removal is noticed")
        assert bag.failure is None
        bag.write("/words", String(data="after"), 20)
    [removed] = bag.removed
    assert removed.startswith("4 messages from 0.000 s to 0.000 s not recorded: ")
    assert "was removed or moved during the recording" in removed
    recording = Bag(path)
    assert recording.damage == ""
    assert [message.message.data for message in recording.messages(["/words"])] == ["after"]
    [described] = recording.messages(["/ema/actuator_description"])
    assert described.message.actuator_id == "flap"
    assert recording.topics["/words"].count == 1
    assert recording.gaps[0].messages == 4


def test_removed_bag_without_patience_is_an_error(tmp_path: Path):
    path = tmp_path / "one.mcap"
    bag = BagWriter(path)
    bag.add_topic("/words", String, QOS)
    path.unlink()
    with pytest.raises(FileNotFoundError, match="was removed or moved during the recording"):
        bag.flush()
    with pytest.raises(FileNotFoundError):
        bag.close()
