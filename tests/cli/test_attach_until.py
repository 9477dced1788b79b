# SPDX-License-Identifier: Apache-2.0
"""The end of the healthy records is given as a time, a duration or a number of records."""

import math

import pytest

from ema_cli.bags.healthy_until import HealthyUntil

HOUR_NS = 3_600_000_000_000
NOV_3_NS = 1_793_664_000_000_000_000


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("10", HealthyUntil(records=10)),
        ("2h", HealthyUntil(duration_s=7200.0)),
        (" 1.5 d ", HealthyUntil(duration_s=129_600.0)),
        ("90 s", HealthyUntil(duration_s=90.0)),
        ("2026-11-03", HealthyUntil(time_ns=NOV_3_NS)),
        ("2026-11-03T01:00", HealthyUntil(time_ns=NOV_3_NS + HOUR_NS)),
        ("2026-11-03T02:00+01:00", HealthyUntil(time_ns=NOV_3_NS + HOUR_NS)),
    ],
)
def test_text_is_a_time_a_duration_or_a_number(text, expected):
    assert HealthyUntil.of(text) == expected


@pytest.mark.parametrize("text", ["0", "", "yesterday", "2 weeks", "-3", "2026-13-01", "nan h"])
def test_other_texts_are_refused_with_the_expected_formats(text):
    with pytest.raises(ValueError, match="expected a number of records such as 10, a duration"):
        HealthyUntil.of(text)


@pytest.mark.parametrize(
    ("until", "healthy"),
    [
        (HealthyUntil(records=2), [True, True, False]),
        (HealthyUntil(duration_s=3700.0), [True, True, False]),
        (HealthyUntil(time_ns=NOV_3_NS + 1e9), [True, False, False]),
        (HealthyUntil(time_ns=math.inf), [True, True, True]),
    ],
)
def test_records_up_to_the_end_are_healthy(until, healthy):
    ends = [NOV_3_NS + i * HOUR_NS for i in range(3)]
    assert [until.includes(end, NOV_3_NS, i) for i, end in enumerate(ends)] == healthy
