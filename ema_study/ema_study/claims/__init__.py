"""The claims of the thesis's chapter 4, each measured on our own responses."""

from functools import cache

import pandas as pd

from ema_study.claims.claim import Claim
from ema_study.claims.electronics import calibration, gain, noise
from ema_study.claims.mechanical import backlash, friction
from ema_study.claims.motor import eccentricity, short_circuit

__all__ = ["Claim", "claims", "claims_table"]

_GROUPS = (friction, backlash, short_circuit, eccentricity, gain, noise, calibration)


@cache
def claims() -> tuple[Claim, ...]:
    """Measure all claims."""
    return tuple(claim for group in _GROUPS for claim in group())


def claims_table() -> pd.DataFrame:
    """Return the claims, one a row, with ``agrees`` as "yes" or "no"."""
    frame = pd.DataFrame(claims())
    return frame.assign(
        fault=frame["fault"].str.replace("_", " "),
        agrees=frame["agrees"].map({True: "yes", False: "no"}),
    )
