"""Estimates of earlier tests in little memory: a history has thousands, of which few are read."""

import pickle
import zlib
from functools import cache
from typing import Final

import numpy as np

from ema_core.faults import N_FAULTS, FaultVector
from ema_monitor.identification.estimate import Estimate

_LEVEL: Final = 6
_PROTOCOL: Final = 5


def pack(estimate: Estimate) -> bytes:
    """Return an estimate in about 0.6 kB in place of 2.4 kB, for this process alone.

    Parameters
    ----------
    estimate
        Every bit of which is kept.
    """
    packer = zlib.compressobj(_LEVEL, zdict=_alike())
    return packer.compress(pickle.dumps(estimate, _PROTOCOL)) + packer.flush()


def unpack(packed: bytes) -> Estimate:
    """Return the estimate that ``pack`` was given."""
    unpacker = zlib.decompressobj(zdict=_alike())
    return pickle.loads(unpacker.decompress(packed) + unpacker.flush())


@cache
def _alike() -> bytes:
    """Return what all packed estimates have in common, the names above all."""
    k = np.zeros(N_FAULTS)
    flags = k.astype(bool)
    common = Estimate(
        1_700_000_000_000_000_000, 1_700_000_000_500_000_000, "lm", 0, "0123456789abcdef",
        FaultVector.of(k), np.zeros((N_FAULTS, N_FAULTS)), flags, 0.0, 0.0, 1.0, 3.5, 0.1, 100,
        0.1, True, "", flags.copy(),
    )  # fmt: skip
    return pickle.dumps(common, _PROTOCOL)
