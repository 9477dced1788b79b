# SPDX-License-Identifier: Apache-2.0
"""Reading of LeRobot data sets (v2 and v3): joint states and actions of episodes."""

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ema_bags.inputs.array_columns import list_column, parts_of, split_columns

EPISODE: Final = "episode_index"
"""Column that changes with each episode."""

_INFO: Final = Path("meta", "info.json")
_DATA: Final = "data/*/*.parquet"
_TIME: Final = "timestamp"
_FRAME: Final = "frame_index"
_PREFIXES: Final = ("observation.", "action")


def is_data_set(path: Path) -> bool:
    """Return whether a folder is a LeRobot data set."""
    return (path / _INFO).is_file()


def read_data_set(path: Path) -> dict[str, NDArray[Any]]:
    """Return the columns of all episodes: time, episode, and each element of states and actions.

    Elements are named by the features in ``meta/info.json``: ``observation.state.elbow.pos``. The
    time starts again in each episode.

    Raises
    ------
    ValueError
        If the folder has no readable description or data, or no feature with numbers.
    """
    import pyarrow as pa
    from pyarrow import parquet

    features, fps = _features(path)
    files = sorted(path.glob(_DATA))
    if not files:
        raise ValueError(f"{path} is a LeRobot data set without data: expected {_DATA}")
    parts: list[dict[str, NDArray[Any]]] = []
    for file in files:
        try:
            source = parquet.ParquetFile(file)
            wanted = [name for name in source.schema_arrow.names if name in features]
            stored = source.read(columns=[*wanted, *_present(source.schema_arrow.names)])
        except (pa.ArrowException, OSError) as error:
            raise ValueError(f"{file} is not a Parquet file: {error}") from error
        if stored.num_rows:
            parts.append(_columns(stored, features, wanted, fps))
    if not parts or not (parts[0].keys() - {_TIME, EPISODE}):
        listed = ", ".join(features) or "none"
        raise ValueError(f"{path} has no states of joints: features with numbers: {listed}")
    if any(part.keys() != parts[0].keys() for part in parts):
        raise ValueError(f"{path}: its files have different columns")
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _features(path: Path) -> tuple[dict[str, tuple[str, ...]], float]:
    """Return the element names of each numeric feature, and the frames per second (0: unknown)."""
    try:
        info = json.loads((path / _INFO).read_text(encoding="utf-8"))
        features = {
            str(name): parts_of(feature.get("names"))
            for name, feature in info["features"].items()
            if str(name).startswith(_PREFIXES)
            and str(feature.get("dtype", "")).startswith(("float", "int"))
            and len(feature.get("shape", ())) == 1
        }
        return features, float(info.get("fps") or 0.0)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path / _INFO} does not describe a data set: {error!r}") from error


def _present(names: list[str]) -> list[str]:
    return [name for name in (_TIME, _FRAME, EPISODE) if name in names]


def _columns(
    stored: Any, features: dict[str, tuple[str, ...]], wanted: list[str], fps: float
) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {}
    for name in _present(stored.column_names):
        columns[name] = np.asarray(stored[name].to_numpy()).reshape(-1)
    frames = columns.pop(_FRAME, None)
    if _TIME not in columns and frames is not None and fps > 0.0:
        columns[_TIME] = frames / fps
    if _TIME in columns:
        # Single precision would look like jitter.
        columns[_TIME] = np.asarray(columns[_TIME], dtype=float)
    for name in wanted:
        array = list_column(stored[name])
        if array is not None:
            columns |= split_columns(name, array.astype(float), features[name])
    return columns
