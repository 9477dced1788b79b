"""What reads inputs that others may have written, and what it may raise because of them."""

import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any, Final

import fuzz_mutators
import fuzz_seeds
import yaml
from made_tests import UNIT, entry_at

from ema_core.description import ActuatorDescription
from ema_core.yaml_file import load_yaml
from ema_inputs.files import InputFile
from ema_inputs.importing import import_series
from ema_inputs.mapping_file import load_mapping, mapping_from, mapping_text
from ema_monitor.calibrations import load_calibration
from ema_monitor.health import HealthLimits
from ema_monitor.identification.settings import SearchSettings
from ema_monitor.prognosis.growth.known_laws import KnownLawTexts
from ema_monitor.prognosis.growth.settings import TrackerSettings
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History
from ema_monitor.prognosis.requirements.requirements import RequirementLimits
from ema_monitor.prognosis.service import Service
from ema_monitor.windows.trigger import TriggerSettings
from ema_recording import schema
from ema_recording.reader import Bag
from ema_recording.telemetry import read_telemetry
from ema_recording.windows import find_recorded_windows
from ema_ros.actuator_file import load_description
from ema_ros.messages import (
    description_from_message,
    measured_from_message,
    stamped_faults_from_message,
    telemetry_from_message,
)

FOLDER: Final = tempfile.TemporaryDirectory(
    prefix="fuzz_", dir="/dev/shm" if Path("/dev/shm").is_dir() else None
)
"""For the files of inputs: in memory, where there is such a folder."""

_SETTINGS: Final = (
    *(HealthLimits, RequirementLimits, TrackerSettings, KnownLawTexts, Service),
    *(SearchSettings, TriggerSettings),
)
_CONVERSIONS: Final[dict[str, Callable[[Any], Any]]] = {
    "TelemetryBlock": telemetry_from_message,
    "ActuatorDescription": description_from_message,
    "FaultVectorStamped": stamped_faults_from_message,
    "MeasuredCauses": measured_from_message,
}
_JOINED: Final = 3


@dataclass(frozen=True)
class Target:
    """Something that reads inputs.

    Attributes
    ----------
    attack
        Reads an input; whatever it raises was not to be.
    seeds
        Returns valid inputs.
    mutate
        Returns an input changed in its structure, of the input and a seed; None: in bytes alone.
    words
        What an input may be put together of.
    most_bytes
        Size of the largest input.
    """

    attack: Callable[[bytes], None]
    seeds: Callable[[], list[bytes]]
    mutate: Callable[[bytes, int], bytes] | None = None
    words: Iterable[str] = ()
    most_bytes: int = 4096


def _file(name: str, data: bytes) -> Path:
    path = Path(FOLDER.name) / name
    path.write_bytes(data)
    return path


def _bag(data: bytes) -> None:
    _forget_schemas()
    path = _file("input.mcap", data)
    try:
        bag = Bag(path)
    except ValueError:
        return
    list(bag.raw_messages())
    assert all(isinstance(name, str) for name in bag.writers)
    for name in bag.topics:
        with suppress(ValueError):
            for _ in bag.messages([name]):
                pass
    with suppress(ValueError):
        find_recorded_windows(read_telemetry(bag))


def _message(data: bytes) -> None:
    name = fuzz_seeds.TYPES[data[0] % len(fuzz_seeds.TYPES) if data else 0]
    trim = schema.trimmer(name)
    if not data[1:].startswith(trim(data[1:])):
        raise AssertionError("what is behind a message is not all that is cut off")
    try:
        message = schema.decoder(name, schema.schema_text(name))(data[1:])
    except ValueError:
        return
    convert = _CONVERSIONS.get(name.rpartition("/")[2])
    if convert is not None:
        with suppress(ValueError):
            convert(message)


def _schema(data: bytes) -> None:
    _forget_schemas()
    text = data.decode("utf-8", "replace")
    with suppress(ValueError):
        schema.to_installed("ema_interfaces/msg/Usage", text, "")
    try:
        decode = schema.decoder("a/msg/B", text)
    except ValueError:
        return
    for content in (b"", b"\0\1\0\0" + bytes(40), b"\0\1\0\0" + b"\xff" * 40):
        with suppress(ValueError):
            decode(content)


def _forget_schemas() -> None:
    """Drop the decoders of other inputs: a process that reads a thousand recordings has as many."""
    schema.decoder.cache_clear()


def _description(data: bytes) -> None:
    with suppress(ValueError):
        load_description(_file("input.yaml", data))


def _calibration(data: bytes) -> None:
    with suppress(ValueError):
        loaded = load_calibration(_file("input.yaml", data))
        assert loaded.calibration_id
        loaded.unit_mismatch(ActuatorDescription())


def _mapping(data: bytes) -> None:
    try:
        mapping = load_mapping(_file("input.yaml", data))
    except ValueError:
        return
    if mapping_from(yaml.safe_load(mapping_text(mapping))) != mapping:
        raise AssertionError("the mapping that is written is another one")


def _settings(data: bytes) -> None:
    try:
        given = load_yaml(_file("input.yaml", data))
    except ValueError:
        return
    if not isinstance(given, dict):
        return
    for kind in _SETTINGS:
        names = [item.name for item in fields(kind) if "description" in item.metadata]
        with suppress(ValueError):
            made = kind(**{name: given[name] for name in names if name in given})
            if isinstance(made, KnownLawTexts):
                made.laws()


def _history(data: bytes) -> None:
    """Whatever the file was, nothing is raised, and the next test is kept and found again."""
    folder = Path(FOLDER.name)
    for old in folder.glob("unit.*"):
        old.unlink()
    path = _file("unit.sqlite", data)
    history = History(*UNIT, path)
    GrowthRecord(HealthLimits(), TrackerSettings(), history.entries[:_JOINED], history.growth)
    entry = entry_at(5000)
    history.append(entry)
    history.close()
    again = History(*UNIT, path)
    again.close()
    found = [item.stamp_ns for item in again.entries]
    if entry.stamp_ns not in found or again.problem or len(found) != len(history.entries):
        raise AssertionError(
            f"{len(history.entries)} tests written ({history.problem!r}), {len(found)} found: "
            f"{again.problem!r}"
        )


def _growth(data: bytes) -> None:
    GrowthRecord(HealthLimits(), TrackerSettings(), [], data)


def _table(data: bytes) -> None:
    description = ActuatorDescription()
    with suppress(ValueError):
        table = InputFile(_file("input.csv", data))
        table.contents()
        mapping = table.guess(description).mapping
        imported = import_series(table.series(mapping), mapping, description)
        for _ in imported.blocks():
            pass


@cache
def _small_bag() -> bytes:
    return fuzz_seeds.bags()[3]


def _metadata(data: bytes) -> None:
    folder = Path(FOLDER.name) / "bag"
    folder.mkdir(exist_ok=True)
    (folder / "input_0.mcap").write_bytes(_small_bag())
    (folder / "metadata.yaml").write_bytes(data)
    with suppress(ValueError, FileNotFoundError):
        list(Bag(folder).raw_messages())


_YAML: Final = (
    *("null", "true", "~", ".nan", ".inf", "-.inf", "1e400", "1e-400", "9223372036854775808"),
    *("-1", "0", "{}", "[]", "''", "&a ", "*a", "<<: ", "!!float ", "!!int ", "!!binary ", "0x"),
    *("!!timestamp ", "2024-01-01", "1_000", "12:30:45", "- ", ": ", "\n", "? ", "|\n", ">-\n"),
    *("!!python/object:os.system ", "---\n", "...\n", "%YAML 1.2\n", '"\\u0000"', "\\ud800", "\t"),
)
TARGETS: Final = {
    "bag": Target(_bag, fuzz_seeds.bags, fuzz_mutators.change_bag, (), 60_000),
    "message": Target(_message, fuzz_seeds.messages),
    "schema": Target(
        _schema,
        fuzz_seeds.schemas,
        words=(
            "string",
            "uint8",
            "[<=",
            "]",
            "=",
            "#",
            "\n" + "=" * 80 + "\nMSG: a/B\n",
            "float64",
        ),
    ),
    "description": Target(_description, fuzz_seeds.descriptions, words=_YAML),
    "calibration": Target(_calibration, fuzz_seeds.calibrations, words=_YAML, most_bytes=20_000),
    "mapping": Target(_mapping, fuzz_seeds.mappings, words=_YAML),
    "settings": Target(
        _settings,
        fuzz_seeds.settings,
        words=(*_YAML, *(item.name + ": " for kind in _SETTINGS for item in fields(kind))),
    ),
    "metadata": Target(_metadata, fuzz_seeds.metadata, words=_YAML),
    "history": Target(_history, fuzz_seeds.histories, fuzz_mutators.change_history, (), 60_000),
    "growth": Target(_growth, fuzz_seeds.growth),
    "table": Target(
        _table,
        fuzz_seeds.tables,
        words=("nan", "inf", "1e400", "-", ";", "\t", "\ufeff", "2024-01-01T00:00:00Z", '"', "0x1"),
    ),
}
"""What is attacked, by name."""
