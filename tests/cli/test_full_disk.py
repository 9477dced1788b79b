# SPDX-License-Identifier: Apache-2.0
"""If a file cannot be written completely, the error names it and no partial file remains."""

import resource
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ..commands import SAMPLE


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Make writes beyond ``size`` bytes of a file fail in this process, as on a full disk."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    writes_no_bytecode = sys.dont_write_bytecode
    # Under the limit, Python 3.11 would leave truncated .pyc files of the modules that it imports.
    sys.dont_write_bytecode = True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
        sys.dont_write_bytecode = writes_no_bytecode


@pytest.fixture(scope="module", autouse=True)
def _kernels(ema, tmp_path_factory) -> None:
    """Compile the kernels before, because their cache files are written as well."""
    assert ema("plot", SAMPLE, "--window", "0", "-o", tmp_path_factory.mktemp("k") / "k.png")


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("simulate",), "case.mcap"),
        (("simulate",), "case"),
        (("recover", SAMPLE), "whole.mcap"),
        (("plot", SAMPLE), "case.png"),
        (("calibrate", SAMPLE, "--accept-defects", "--accepted-by", "Ada"), "c.yaml"),
    ],
)
def test_file_that_could_not_be_written_is_removed(
    ema: Callable, tmp_path: Path, arguments: tuple, name: str
):
    with largest_file(4000):
        result = ema(*arguments, "-o", tmp_path / name)
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1] == f"Error: {tmp_path / name}: File too large"
    assert list(tmp_path.iterdir()) == []


def test_existing_picture_is_kept(ema: Callable, tmp_path: Path):
    picture = tmp_path / "case.png"
    picture.write_bytes(b"precious")
    command = ("plot", SAMPLE, "-o", picture, "--replace")
    with largest_file(4000):
        assert ema(*command).exit_code == 1
    assert picture.read_bytes() == b"precious"
    assert ema(*command).exit_code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert list(tmp_path.iterdir()) == [picture]


def test_life_that_could_not_be_written_leaves_no_partial_folder(ema: Callable, tmp_path: Path):
    with largest_file(4000):
        result = ema("lives", "--fault", "friction", "-o", tmp_path / "lives")
    assert result.exit_code == 1
    assert "File too large" in result.stderr
    assert "Errno" not in result.stderr
    assert list((tmp_path / "lives").iterdir()) == []
