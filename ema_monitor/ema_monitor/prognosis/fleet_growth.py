# SPDX-License-Identifier: Apache-2.0
"""Growth evidence from a fleet: collection from histories, merging, and storage."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from ema_core.description import UnitKey
from ema_core.event_kinds import EventKind
from ema_core.files import complete_file, open_regular_file
from ema_monitor.health import HealthLimits
from ema_monitor.prognosis.growth.fleet_prior import (
    LEAST_LOG,
    GrownFault,
    curves_without_fleet,
    distribution,
    grid_digest,
)
from ema_monitor.prognosis.growth.tracker_settings import FleetPrior, TrackerSettings
from ema_monitor.prognosis.growth_record import GrowthRecord
from ema_monitor.prognosis.history import History

SUFFIX: Final = ".npz"
"""Suffix of fleet files."""
_FORMAT: Final = 1
_MOST_BYTES: Final = 500_000_000


class UnitGrowth(NamedTuple):
    """Growth evidence from one unit."""

    tests: int
    """Number of tests."""
    faults: tuple[GrownFault, ...]
    """Evidence about each growing fault."""


@dataclass(frozen=True, eq=False)
class FleetGrowth:
    """Growth evidence from the units of a fleet."""

    grid: str
    """Digest of the curves, rates and limits to which the evidence refers."""
    units: Mapping[str, UnitGrowth] = field(default_factory=dict)
    """Evidence by unit digest, see ``unit_digest``."""
    names: frozenset[str] = frozenset()
    """Names of the fleets that were merged."""

    def together(self, other: "FleetGrowth") -> "FleetGrowth":
        """Return both fleets, merged; if both contain a unit, the entry with more tests is kept.

        Raises
        ------
        ValueError
            If the fleets have different limits.
        """
        if self.grid != other.grid:
            raise ValueError(
                "the fleets have different limits, or were written by different versions: grids "
                f"{other.grid} and {self.grid}"
            )
        units = dict(self.units)
        for digest, unit in other.units.items():
            # Break ties by content, so that the result does not depend on the order.
            if digest not in units or _rank(units[digest]) < _rank(unit):
                units[digest] = unit
        return FleetGrowth(self.grid, units, self.names | other.names)

    def prior(self, limits: HealthLimits, without: UnitKey | None = None) -> FleetPrior:
        """Return the distribution of curves and rates over the units, fitted to their evidence.

        Parameters
        ----------
        limits
            End-of-life limits of the unit that uses the prior.
        without
            Unit to exclude, so that its own tests do not count twice.

        Raises
        ------
        ValueError
            If the fleet has different limits.
        """
        if self.grid != (expected := grid_digest(limits)):
            raise ValueError(
                f"the fleet has different limits, or was written by a different version: grid "
                f"{self.grid}, expected {expected}"
            )
        excluded = unit_digest(*without) if without else ""
        grown: dict[str, list[GrownFault]] = {}
        digest, count = hashlib.sha256(self.grid.encode()), 0
        for name, unit in sorted(self.units.items()):
            if name == excluded or not unit.faults:
                continue
            count += 1
            for fault in unit.faults:
                grown.setdefault(fault.kind, []).append(fault)
                digest.update(fault.kind.encode() + fault.log_likelihood.tobytes())
        before = curves_without_fleet(limits)
        shares = {
            kind: distribution([fault.log_likelihood for fault in faults], before[kind])
            for kind, faults in grown.items()
        }
        return FleetPrior(
            digest.hexdigest()[:16],
            count,
            ", ".join(sorted(self.names)),
            {kind: len(faults) for kind, faults in grown.items()},
            shares,
        )

    def write(self, path: Path) -> None:
        """Write the fleet to a file, atomically.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        digests = sorted(self.units)
        faults = [
            (number, fault)
            for number, digest in enumerate(digests)
            for fault in self.units[digest].faults
        ]
        arrays = {
            "format": np.array(_FORMAT),
            "grid": np.array(self.grid),
            "names": np.array(sorted(self.names), dtype=np.str_),
            "units": np.array(digests, dtype=np.str_),
            "tests": np.array([self.units[digest].tests for digest in digests], dtype=np.int64),
        }
        for kind in sorted({fault.kind for _, fault in faults}):
            of_kind = [(number, fault) for number, fault in faults if fault.kind == kind]
            arrays[f"unit_of.{kind}"] = np.array([number for number, _ in of_kind], dtype=np.int64)
            arrays[f"growth.{kind}"] = np.stack([fault.log_likelihood for _, fault in of_kind])
        with complete_file(path) as partial, partial.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)

    @classmethod
    def read(cls, path: Path) -> "FleetGrowth":
        """Return the fleet in a file written by ``write``.

        Raises
        ------
        ValueError
            If the file is not a fleet file; the error names it.
        OSError
            If the file cannot be read.
        """
        try:
            with open_regular_file(path) as opened, np.load(opened, allow_pickle=False) as file:
                # A small file may expand to large arrays: check sizes first.
                size = sum(item.file_size for item in file.zip.infolist())
                if size > _MOST_BYTES:
                    raise ValueError(f"it expands to {size} bytes, expected at most {_MOST_BYTES}")
                return cls._of_arrays(dict(file))
        except OSError:
            raise
        except Exception as error:  # numpy and zipfile raise many types for damaged archives
            raise ValueError(f"{path} is not a fleet file: {error}") from error

    @classmethod
    def _of_arrays(cls, arrays: dict[str, np.ndarray]) -> "FleetGrowth":
        if arrays["format"] != _FORMAT:
            raise ValueError(f"format {arrays['format']}, expected {_FORMAT}")
        faults: list[list[GrownFault]] = [[] for _ in arrays["units"]]
        before = curves_without_fleet(HealthLimits())
        for name in arrays:
            if not name.startswith("growth."):
                continue
            kind = name.removeprefix("growth.")
            if kind not in before:
                raise ValueError(f"unknown kind of fault {kind!r}")
            log = arrays[name].astype(np.float16)
            if log.shape[1:] != before[kind].shape:
                raise ValueError(f"{name} has the shape {log.shape}")
            if not np.all((log >= LEAST_LOG) & (log <= 0.0)) or not np.all(log.max((1, 2)) == 0.0):
                raise ValueError(f"{name} has impossible values: expected {LEAST_LOG:g} to 0")
            for number, log_likelihood in zip(arrays[f"unit_of.{kind}"], log, strict=True):
                faults[number].append(GrownFault(kind, log_likelihood))
        units = {
            str(digest): UnitGrowth(int(tests), tuple(unit_faults))
            for digest, tests, unit_faults in zip(
                arrays["units"], arrays["tests"], faults, strict=True
            )
        }
        names = frozenset(str(name) for name in arrays["names"])
        return cls(str(arrays["grid"]), units, names)


def _rank(unit: UnitGrowth) -> tuple[int, bytes]:
    return unit.tests, b"".join(fault.log_likelihood.tobytes() for fault in unit.faults)


def unit_digest(actuator_id: str, serial_number: str) -> str:
    """Return a digest that identifies a unit without revealing its name."""
    return hashlib.sha256(f"{actuator_id}\0{serial_number}".encode()).hexdigest()[:16]


def fleet_of(histories: Iterable[History], limits: HealthLimits, name: str = "") -> FleetGrowth:
    """Return the growth evidence from unit histories.

    Parameters
    ----------
    histories
        History of each unit. A repaired fault contributes its growth before the repair and,
        separately, any growth after it.
    limits
        Limits at which life ends.
    name
        Name of the fleet; may be empty.
    """
    units = {unit_digest(*history.unit): _unit_of(history, limits) for history in histories}
    return FleetGrowth(grid_digest(limits), units, frozenset([name] if name else []))


def _unit_of(history: History, limits: HealthLimits) -> UnitGrowth:
    record = GrowthRecord(limits, TrackerSettings())
    repaired: list[GrownFault] = []
    growing: dict[str, GrownFault] = {}
    for entry in history.entries:
        before, occurrences = growing, record.add(entry)
        growing = record.tracker.grown_faults()
        if any(item.kind is EventKind.REPAIR for item in occurrences):
            repaired += [fault for name, fault in before.items() if name not in growing]
    return UnitGrowth(record.tests, (*repaired, *growing.values()))
