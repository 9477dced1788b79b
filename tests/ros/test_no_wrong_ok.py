# SPDX-License-Identifier: Apache-2.0
"""No output reports OK without evidence, in 10,000 random sequences of steps."""

import pytest

from ..attacks.stateful import walk
from ..attacks.walk_claims import Claimed

SEQUENCES, STEPS = 10_000, 20
PARTS = 10


@pytest.mark.long
@pytest.mark.parametrize("part", range(PARTS))
def test_no_wrong_ok_in_thousands_of_sequences(part: int):
    walk(Claimed, 7919 + part, SEQUENCES // PARTS, STEPS)
