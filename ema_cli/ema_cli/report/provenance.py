"""Where a report comes from: files with their hashes, unit, calibration, versions, command."""

import hashlib
import platform
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from ema_cli.bags.source_options import SourceOptions
from ema_cli.bags.unit_record import find_bags
from ema_cli.unit_diagnosis import UnitDiagnosis
from ema_core import __version__
from ema_core.wording import counted

_PACKAGES: Final = ("numpy", "numba", "mcap", "rosbags", "pyyaml", "matplotlib", "jinja2")


@dataclass(frozen=True)
class File:
    """A file that was read.

    Attributes
    ----------
    role
        What it was read for.
    size
        Bytes.
    sha256
        Digest of its content, in hexadecimal, or why there is none.
    """

    path: str
    role: str
    size: int
    sha256: str


def files_read(paths: Sequence[Path], source: SourceOptions, told: UnitDiagnosis) -> list[File]:
    """Return the files that a diagnosis rests on."""
    windows = Counter(told.record.bags[window.end_ns] for window in told.record.windows)
    found = []
    for bag in find_bags(paths):
        for member in _members(bag):
            found.append(_file(member, f"bag, {counted(windows[bag], 'window')} used"))
    for path, role in (
        (told.options.calibration_file, "calibration"),
        (source.actuator_file, "description of the actuator"),
    ):
        if path is not None:
            found.append(_file(path, role))
    return found


def _members(bag: Path) -> Iterator[Path]:
    """Yield the files of a bag, itself or in its folder."""
    if bag.is_dir():
        yield from sorted(item for item in bag.iterdir() if item.is_file())
    else:
        yield bag


def _file(path: Path, role: str) -> File:
    try:
        with path.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
    except OSError as error:
        # A bag that could not be read is named among the remarks as well.
        digest = f"not read: {error.strerror}"
    return File(str(path), role, path.stat().st_size, digest)


def parameters_of(told: UnitDiagnosis) -> list[tuple[str, float, str, str]]:
    """Return symbol, nominal value, unit and meaning of the parameters of the actuator."""
    nominal = told.record.description.parameters
    return [
        (
            item.name,
            getattr(nominal, item.name),
            item.metadata["unit"],
            item.metadata["description"],
        )
        for item in fields(nominal)
    ]


def calibration_of(told: UnitDiagnosis) -> dict[str, str]:
    """Return what identifies the calibration, by what it is."""
    one = told.calibration
    missed = ", ".join(name.replace("_", " ") for name in one.not_learned)
    return {
        "identity": one.calibration_id,
        "from": told.options.calibration_source,
        "unit": f"{one.actuator_id} ({one.serial_number})",
        "healthy windows": str(one.windows),
        "residual of a healthy window": one.residual_in_words,
        "not learned of the unit": missed or "nothing",
    }


def versions() -> dict[str, str]:
    """Return the versions of what made the report, by name."""
    found = {"ema": __version__, "Python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed as a package"
    return found
