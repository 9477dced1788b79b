# SPDX-License-Identifier: Apache-2.0
"""Data sets in the layouts of LeRobot: a file per episode (v2) or for several episodes (v3)."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from .joint_motion import moves

FPS = 30
EPISODES = 3
JOINTS = ("shoulder_pan", "shoulder_lift", "gripper")
_SCALARS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def write(folder: Path, version: str) -> dict[str, NDArray[np.float32]]:
    """Write a data set; return the positions of each joint in all episodes."""
    names = [f"{joint}.pos" for joint in JOINTS]
    vector = {
        "dtype": "float32",
        "shape": [len(names)],
        "names": names if version == "v3.0" else {"motors": names},
    }
    features = {
        "observation.state": vector,
        "action": vector,
        "observation.images.top": {
            "dtype": "video",
            "shape": [3, 480, 640],
            "names": ["channels", "height", "width"],
        },
        **{name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in _SCALARS.items()},
    }
    (folder / "meta").mkdir(parents=True)
    info = {"codebase_version": version, "robot_type": "so100", "fps": FPS, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info), encoding="utf-8")
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    tables, positions = [], []
    for episode in range(EPISODES):
        table, state = _episode(episode, version)
        tables.append(table)
        positions.append(state)
        if version != "v3.0":
            parquet.write_table(table, data / f"episode_{episode:06d}.parquet")
    if version == "v3.0":
        parquet.write_table(pa.concat_tables(tables), data / "file-000.parquet")
    return dict(zip(JOINTS, np.concatenate(positions).T, strict=True))


def _episode(number: int, version: str) -> tuple[pa.Table, NDArray[np.float32]]:
    motions = [
        moves(14.0 + number, FPS, 20.0 + 5.0 * k, 10 * number + k)[0] for k in range(len(JOINTS))
    ]
    state, action = (
        np.column_stack([motion[name] for motion in motions]).astype(np.float32)
        for name in ("position", "command")
    )
    n = len(state)

    def lists(values: NDArray[np.float32]) -> pa.Array:
        if version != "v3.0":
            return pa.array(list(values))
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), len(JOINTS))

    frames = np.arange(n)
    columns = {
        "action": lists(action),
        "observation.state": lists(state),
        "timestamp": pa.array((frames / FPS).astype(np.float32)),
        "frame_index": frames,
        "episode_index": np.full(n, number),
        "index": frames + 1000 * number,
        "task_index": np.zeros(n, dtype=np.int64),
    }
    return pa.table(columns), state
