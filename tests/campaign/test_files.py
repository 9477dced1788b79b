"""Where files fail, nothing is lost but the open chunk or the current test."""

import pytest

pytestmark = pytest.mark.slow


def test_nothing_is_lost_where_files_fail(held):
    counts = held("files", 0, 60)
    # Seven ways to fail, four kinds of files; in a quarter of the trials the end comes before.
    assert sum("nothing failed" not in name for name in counts) > 15


@pytest.mark.long
@pytest.mark.parametrize("number", [1, 2])
def test_nothing_is_lost_in_hundreds_of_trials(held, number: int):
    held("files", number)
