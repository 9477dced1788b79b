# SPDX-License-Identifier: Apache-2.0
"""Healthy records survive storage, and thinned records keep samples of every day."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ema_core.causes import CauseEstimate
from ema_monitor.baselines.record_files import RecordFiles, StoredRecord, thinned
from ema_monitor.joint.record import NS_A_DAY

from .healthy import START_NS, record


def test_record_survives_storage_with_the_resolution_of_its_sensor(tmp_path: Path):
    """After 1,600 turns, a float32 angle is off by up to 0.5 mrad; encoders resolve 0.1 mrad."""
    window = record(0, offset=1e4)
    telemetry = window.telemetry
    lost = np.zeros(len(telemetry), dtype=bool)
    lost[7:9] = True
    measured = (CauseEstimate("winding_temperature", 31.5, 0.5),)
    payload = np.where(np.arange(len(telemetry)) < 100, 0.0, 2.5)
    telemetry = replace(telemetry, interpolated=lost, payload=payload)
    window = replace(window, telemetry=telemetry, measured=measured)
    window = replace(window, omitted=(range(300, 900), range(1000, 5000)))
    stored = RecordFiles(tmp_path / "records").add(window)
    assert stored is not None
    [read] = RecordFiles(tmp_path / "records").read([stored])
    np.testing.assert_allclose(read.telemetry.position, telemetry.position, atol=1e-7, rtol=0.0)
    np.testing.assert_allclose(read.telemetry.current, telemetry.current, rtol=1e-6)
    np.testing.assert_array_equal(read.telemetry.interpolated, lost)
    np.testing.assert_array_equal(read.telemetry.payload, payload)
    assert read.measured == measured
    assert (read.start_ns, read.end_ns, read.sample_period) == (
        window.start_ns,
        window.end_ns,
        0.01,
    )


def test_record_without_speed_and_command_is_restored_without_them(tmp_path: Path):
    telemetry = replace(record(0).telemetry, command=np.zeros(0), speed=np.zeros(0))
    files = RecordFiles(tmp_path)
    stored = files.add(replace(record(0), telemetry=telemetry))
    assert stored is not None
    assert files.read([stored])[0].telemetry.missing == ("command", "speed")


def test_record_stored_without_a_payload_is_read_without_it(tmp_path: Path):
    files = RecordFiles(tmp_path)
    stored = files.add(record(0))
    assert stored is not None
    with np.load(stored.path) as arrays:
        older = {name: arrays[name] for name in arrays.files if name != "payload"}
    np.savez_compressed(stored.path, **older)
    [read] = files.read([stored])
    assert not read.telemetry.has_payload


def test_record_without_a_column_is_ignored_and_deleted(tmp_path: Path):
    files = RecordFiles(tmp_path)
    stored = files.add(record(0))
    assert stored is not None
    with np.load(stored.path) as arrays:
        incomplete = {name: arrays[name] for name in arrays.files if name != "current"}
    np.savez_compressed(stored.path, **incomplete)
    assert list(files.read([stored])) == []
    assert not stored.path.exists()


def test_repeated_record_is_stored_once(tmp_path: Path):
    files = RecordFiles(tmp_path)
    assert files.add(record(1)) is not None
    assert files.add(record(1)) is None
    assert RecordFiles(tmp_path).add(record(1)) is None


def test_damaged_record_is_ignored_and_deleted(tmp_path: Path):
    files = RecordFiles(tmp_path)
    good, bad = (files.add(record(number)) for number in (0, 1))
    assert good is not None
    assert bad is not None
    bad.path.write_bytes(good.path.read_bytes()[:500])
    (tmp_path / "notes.npz").write_bytes(b"")
    files = RecordFiles(tmp_path)
    assert [window.start_ns for window in files.read(files.stored)] == [good.stamp_ns]
    assert not bad.path.exists()
    assert files.stored == [good]


def test_thinned_records_keep_every_day():
    records = [
        StoredRecord(START_NS + day * NS_A_DAY + number * 10**9, Path(f"{day}-{number}"))
        for day, count in enumerate((40, 3, 20))
        for number in range(count)
    ]
    kept = thinned(records, 20)
    counts = Counter(record.day - kept[0].day for record in kept)
    assert len(kept) == 20
    assert counts[1] == 3
    assert abs(counts[0] - counts[2]) <= 1
    first_day = [item for item in kept if item.day == kept[0].day]
    # Spread over the day: the first and the last remain.
    assert (first_day[0], first_day[-1]) == (records[0], records[39])
    assert thinned(records, 100) == records


@pytest.mark.parametrize("most", [1, 2])
def test_few_records_are_thinned_to_the_earliest(most: int):
    records = [StoredRecord(START_NS + number, Path(str(number))) for number in range(4)]
    assert thinned(records, most)[0] == records[0]
    assert len(thinned(records, most)) == most


@pytest.mark.parametrize("seed", range(6))
def test_no_damage_of_a_record_raises_an_error(tmp_path: Path, seed: int):
    """The decoder raises errors of several types, depending on the damage."""
    files = RecordFiles(tmp_path)
    stored = files.add(record(0))
    assert stored is not None
    good, rng = stored.path.read_bytes(), np.random.default_rng(seed)
    contents = [b"", good[:10], good.replace(b"\x08\x00", b"\x63\x00")]
    for _ in range(40):
        damaged = bytearray(good)
        for place in rng.integers(len(damaged), size=rng.integers(1, 20)):
            damaged[place] = rng.integers(256)
        contents.append(bytes(damaged))
    for content in contents:
        stored.path.write_bytes(content)
        damaged_files = RecordFiles(tmp_path)
        assert len(damaged_files.read(damaged_files.stored)) <= 1


def test_unreadable_record_is_an_error_and_is_kept(tmp_path: Path, monkeypatch):
    files = RecordFiles(tmp_path)
    stored = files.add(record(0))
    assert stored is not None

    def refuse(*_: object, **__: object) -> None:
        raise OSError(24, "Too many open files")

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", refuse)
        with pytest.raises(OSError, match="Too many open files"):
            files.read(files.stored)
    assert len(files.read(files.stored)) == 1
