# SPDX-License-Identifier: Apache-2.0
"""Reading of third-party recordings with a mapping, usually from the same folder."""

import heapq
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import click

from ema_bags.inputs.defect_wording import defect_line
from ema_bags.inputs.defects import refused
from ema_bags.inputs.files import open_input
from ema_bags.inputs.importing import BLOCK_S, Imported, import_series
from ema_bags.inputs.input_file import InputFile
from ema_bags.inputs.mapping import ColumnMapping, load_mapping
from ema_bags.message_type import type_name
from ema_bags.recording import MemoryRecording
from ema_cli.output import new_bag
from ema_core.description import ActuatorDescription
from ema_ros import topic_names
from ema_ros.actuator_file import load_description, load_descriptions

_PAUSE_NS: Final = 1_000_000_000
_SIMILAR_RATE: Final = 0.1
_BLOCK_IN_MEMORY_S: Final = 0.5  # latency does not matter


def table_recordings(
    table: Path, actuator_file: Path | None, columns: Sequence[str] = ()
) -> Iterator[tuple[list[str], MemoryRecording]]:
    """Yield the recordings of a table, using the mapping in its folder.

    Each recording has the messages that `ema import` would write to a bag. The mapping file is
    ``mapping.yaml`` or is named like the table. Without a description, ``actuator.yaml`` in the
    table's folder is used, or the built-in actuator.

    Parameters
    ----------
    table
        CSV or Parquet file.
    actuator_file
        Description of the actuator.
    columns
        Columns that split the table: each run of rows with constant values in these columns becomes
        a separate recording, yielded with the values.

    Raises
    ------
    ValueError
        If there is no mapping, or the table cannot be used.
    """
    names = table.with_name("mapping.yaml"), table.with_suffix(".yaml")
    mapping_file = next((name for name in names if name.is_file()), None)
    if mapping_file is None:
        raise ValueError(
            f"{table} is a table without a mapping in the same folder: `ema check {table} -o "
            f"{names[0]}` writes one"
        )
    beside = table.with_name("actuator.yaml")
    actuator_file = actuator_file or (beside if beside.is_file() else None)
    if actuator_file is None:
        click.echo(
            f"note: without --actuator, {table} is assumed to be from the built-in actuator",
            err=True,
        )
    mapping = load_mapping(mapping_file)
    actuators = actuators_of(mapping, actuator_file)
    source = open_input(table, mapping)
    parts = source.parts(columns) if columns else [(list[str](), source)]
    for values, part in parts:
        records = [[read_record(part, *actuator, accepts=False)] for actuator in actuators]
        messages = (
            (_full_name(name), type_name(type(message)), message, received_ns, stamp_ns)
            for name, message, received_ns, stamp_ns in _messages(records, _BLOCK_IN_MEMORY_S)
        )
        yield values, MemoryRecording(table, messages)


def actuators_of(
    mapping: ColumnMapping, actuator_file: Path | None
) -> list[tuple[ColumnMapping, ActuatorDescription]]:
    """Return mapping and description of each joint, or of a single actuator.

    The name of a joint becomes the name of its actuator, and replaces ``{joint}`` in the file name.
    Without a file, a single actuator is the built-in actuator, and joints have an unknown drive.
    """
    descriptions = load_descriptions(str(actuator_file or ""), mapping.joints)
    return [(mapping.of_joint(unit.actuator_id), unit) for unit in descriptions]


def described(actuator_file: Path | None) -> ActuatorDescription:
    """Return the description in a file, or the built-in actuator's without a file."""
    return load_description(actuator_file) if actuator_file else ActuatorDescription()


def read_record(
    source: InputFile, mapping: ColumnMapping, description: ActuatorDescription, *, accepts: bool
) -> Imported:
    """Return the telemetry of a file and print its defects.

    Raises
    ------
    ValueError
        If the file cannot be imported, or has defects and neither ``accepts`` nor the mapping
        accepts them.
    """
    file = f"{source.path}, joint {mapping.joint}" if mapping.joint else source.path
    imported = imported_by(source, mapping, description)
    for remark in source.remarks:
        click.echo(f"{file}: {remark}", err=True)
    for defect in imported.defects:
        click.echo(f"{file}: {defect_line(defect)}", err=True)
    wrong = refused(imported.defects, mapping)
    if wrong and not accepts:
        names = ", ".join(item.kind for item in wrong)
        raise ValueError(
            f"{file} is not imported: {names} (see above); correct the mapping, or accept the "
            f"defects with accept: [{names}] in the mapping or --accept-defects"
        )
    return imported


def differs_slightly(sample_period: float, expected: float) -> bool:
    """Return whether a sample period differs from ``expected``, but by less than 10 %.

    Two loggers may have such different periods.
    """
    return sample_period != expected and abs(sample_period / expected - 1.0) < _SIMILAR_RATE


def read_records(
    sources: Sequence[InputFile],
    mapping: ColumnMapping,
    description: ActuatorDescription,
    *,
    accepts: bool,
) -> list[Imported]:
    """Return the telemetry of files, resampled to the first file's rate if the rates are similar.

    The rates of two loggers may differ by a few per cent.

    Parameters
    ----------
    sources
        Files of one actuator, in order.
    mapping, description
        Mapping and actuator of all files.
    accepts
        Whether defects are accepted.
    """
    records = [read_record(source, mapping, description, accepts=accepts) for source in sources]
    period = records[0].description.sample_period
    for number, record in enumerate(records):
        h = record.description.sample_period
        if differs_slightly(h, period):
            source = sources[number]
            records[number] = imported_by(source, mapping, description, period)
            click.echo(
                f"{source.path}: resampled from {1.0 / h:.5g} Hz to {1.0 / period:.5g} Hz, the "
                f"rate of {sources[0].path}",
                err=True,
            )
    return records


def imported_by(
    source: InputFile,
    mapping: ColumnMapping,
    description: ActuatorDescription,
    period: float | None = None,
) -> Imported:
    """Return the telemetry of a file, optionally resampled to ``period`` [s].

    Raises
    ------
    ValueError
        If the file cannot be imported; the message names the file.
    """
    try:
        return import_series(source.series(mapping), mapping, description, period)
    except ValueError as error:
        words = str(error)
        if str(source.path) in words:
            raise
        raise ValueError(f"{source.path}: {words}") from error


def write_records(
    path: Path, actuators: Sequence[Sequence[Imported]], *, overwrite: bool = False
) -> None:
    """Write descriptions and telemetry of actuators to a bag.

    ``actuators`` has the files of each actuator, which are written one after another.
    """
    from ema_ros import topics

    kinds = {name: topics.ACTUATOR_TOPICS[name] for name in (topics.DESCRIPTION, topics.TELEMETRY)}
    if any(record.rises for records in actuators for record in records):
        kinds |= topics.SYSTEM_TOPICS
    with new_bag(path, overwrite=overwrite) as bag:
        for name, (message_class, qos) in kinds.items():
            bag.add_topic(_full_name(name), message_class, qos)
        for name, message, received_ns, stamp_ns in _messages(actuators, BLOCK_S):
            bag.write(_full_name(name), message, received_ns, stamp_ns)


def _full_name(topic: str) -> str:
    return f"{topic_names.NAMESPACE}/{topic}"


def _messages(
    actuators: Sequence[Sequence[Imported]], block_s: float
) -> Iterator[tuple[str, Any, int, int]]:
    """Yield topic, message, reception time and timestamp [ns], in order of reception."""
    of_each = (_messages_of_actuator(records, block_s) for records in actuators)
    return heapq.merge(*of_each, key=lambda item: item[2])


def _messages_of_actuator(
    records: Sequence[Imported], block_s: float
) -> Iterator[tuple[str, Any, int, int]]:
    """Yield topic, message, reception time and timestamp [ns] for an actuator, file by file."""
    from ema_ros.messages import description_to_message, measured_to_message, telemetry_to_message
    from ema_ros.stamps import stamp_from_message

    description = records[0].description
    end_ns, index = None, 0
    for record in records:
        shift_ns, shift = 0, 0
        rises = deque(record.rises)
        for block in record.blocks(block_s):
            if end_ns is None:
                end_ns = block.stamp_ns
                message = description_to_message(description, end_ns)
                yield topic_names.DESCRIPTION, message, end_ns, end_ns
            elif not shift and block.first_index <= index and record is not records[0]:
                # Another file begins: leave a gap of a sample before it, and continue the time.
                shift = index + 1
                if block.stamp_ns <= end_ns:
                    shift_ns = end_ns + _PAUSE_NS - block.stamp_ns
            moved = replace(
                block, stamp_ns=block.stamp_ns + shift_ns, first_index=block.first_index + shift
            )
            # A temperature is written before the telemetry of the same time.
            before_ns = block.stamp_at(len(block) - 1) - record.shift_ns
            while rises and rises[0].stamp_ns <= before_ns:
                rise = rises.popleft()
                at_ns = rise.stamp_ns + record.shift_ns + shift_ns
                measured = measured_to_message(at_ns, [rise.cause], description.actuator_id)
                yield topic_names.MEASURED_CAUSES, measured, end_ns, at_ns
            message = telemetry_to_message(moved, description.actuator_id)
            # Reception times never decrease, even if timestamps do.
            end_ns = max(end_ns, moved.stamp_at(len(moved) - 1))
            index = max(index, moved.first_index + len(moved) - 1)
            yield topic_names.TELEMETRY, message, end_ns, stamp_from_message(message.header.stamp)
