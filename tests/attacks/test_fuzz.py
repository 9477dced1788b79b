# SPDX-License-Identifier: Apache-2.0
"""Changed input files raise documented exceptions only."""

import random
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path

import pytest
import yaml

from ema_bags.inputs.mapping import load_mapping
from ema_bags.reader import Bag
from ema_monitor.calibrations import load_calibration
from ema_monitor.prognosis.history import History
from ema_monitor.recordings.finding import read_windows
from ema_ros.actuator_file import load_description

from ..prognosis.made_tests import UNIT, entry
from .conftest import CASES, SEED

ROOT = Path(__file__).parents[2]
INPUTS = 60
STRANGE = (None, True, -1, 0, 1e300, float("nan"), "", "x" * 300, [], {}, [[[1]]], {"a": {}})
MAPPINGS = ROOT / "ros2_ws/src/ema_bags/mappings"
CALIBRATION = ROOT / "ema_monitor/ema_monitor/calibration/builtin_calibration.yaml"
DESCRIPTION = (
    b"actuator_id: flap\nserial_number: S1\nsample_period: 0.0001\nparameters: {R_s: 2.1}\n"
)


def change_bytes(data: bytes, rng: random.Random) -> bytes:
    """Return data with flipped bits, removed or repeated parts, or a truncated end."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        place, size = rng.randrange(len(changed)), rng.randint(1, 64)
        how = rng.randrange(4)
        if how == 0:
            changed[place] ^= 1 << rng.randrange(8)
        elif how == 1 and len(changed) > 200:
            del changed[place : place + size]
        elif how == 2:
            changed[place:place] = changed[place : place + size]
        elif len(changed) > 200:
            del changed[rng.randrange(len(changed) // 2, len(changed)) :]
    return bytes(changed)


def change_yaml(data: bytes, rng: random.Random) -> bytes:
    """Return YAML in which some values are replaced by strange ones."""
    content = deepcopy(_parsed(data))
    for _ in range(rng.randint(1, 3)):
        at = content
        while isinstance(at, dict | list) and at:
            key = rng.choice(list(at)) if isinstance(at, dict) else rng.randrange(len(at))
            if not isinstance(at[key], dict | list) or rng.random() < 0.3:
                at[key] = rng.choice(STRANGE)
                break
            at = at[key]
    return yaml.dump(content, Dumper=yaml.CSafeDumper).encode()


@cache
def _parsed(data: bytes) -> object:
    return yaml.load(data, yaml.CSafeLoader)


def read_bag(path: Path) -> None:
    bag = Bag(path)
    for _ in bag.messages(list(bag.topics)):
        pass
    read_windows(path)


def read_history(path: Path) -> None:
    history = History(*UNIT, path)
    history.append(entry(len(history.entries)))
    history.close()


def history_bytes(folder: Path) -> bytes:
    history = History(*UNIT, folder / "made.sqlite")
    for number in range(4):
        history.append(entry(number))
    history.close()
    return (folder / "made.sqlite").read_bytes()


Change = Callable[[bytes, random.Random], bytes]
TARGETS: dict[str, tuple[Callable[[Path], bytes], Change, str, Callable[[Path], object]]] = {
    "bag": (
        lambda _: (ROOT / "bags/faulty_flap.mcap").read_bytes(),
        change_bytes,
        "input.mcap",
        read_bag,
    ),
    "history": (history_bytes, change_bytes, "input.sqlite", read_history),
    "calibration": (
        lambda _: CALIBRATION.read_bytes(),
        change_yaml,
        "input.yaml",
        load_calibration,
    ),
    "description": (lambda _: DESCRIPTION, change_yaml, "input.yaml", load_description),
    "mapping": (
        lambda _: sorted(MAPPINGS.glob("*.yaml"))[0].read_bytes(),
        change_yaml,
        "input.yaml",
        load_mapping,
    ),
    "text": (lambda _: CALIBRATION.read_bytes(), change_bytes, "input.yaml", load_calibration),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", TARGETS)
def test_changed_files_are_read_or_refused(name, tmp_path):
    seed_of, change, file_name, read = TARGETS[name]
    original = seed_of(tmp_path)
    unchanged = tmp_path / file_name
    unchanged.write_bytes(original)
    read(unchanged)
    for number in range(INPUTS * CASES):
        folder = tmp_path / str(number)
        folder.mkdir()
        path = folder / file_name
        path.write_bytes(change(original, random.Random(f"{SEED} {name} {number}")))
        try:
            read(path)
        except (ValueError, OSError):
            continue
        except Exception as error:
            raise AssertionError(f"{name} {number} of seed {SEED}: {error!r}") from error
