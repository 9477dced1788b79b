# SPDX-License-Identifier: Apache-2.0
"""Pipes, devices and huge files are refused at once instead of being read without end."""

import os
from pathlib import Path

import pytest

from ema_bags.inputs.tables import read_columns
from ema_bags.reader import Bag
from ema_dashboard.settings import read_address, read_token, tls_context
from ema_monitor.calibrations import load_calibration

from ..commands import SAMPLE, ema


@pytest.fixture(params=["pipe", "device"])
def endless(request, tmp_path):
    """Return a function that makes an endless file with a name."""

    def make(name: str) -> Path:
        path = tmp_path / name
        if request.param == "pipe":
            os.mkfifo(path)
        else:
            path.symlink_to("/dev/zero")
        return path

    return make


@pytest.mark.parametrize(
    "read", [lambda path: read_token(str(path)), lambda path: read_address(str(path))]
)
def test_files_of_token_and_address_of_alerts_must_be_regular(endless, read):
    with pytest.raises(ValueError, match=r"(token_file|alerts) = .* is not a regular file"):
        read(endless("a"))


def test_file_of_a_certificate_must_be_regular(endless):
    path = str(endless("a.pem"))
    with pytest.raises(ValueError, match=r"tls_certificate = .* is not a regular file"):
        tls_context(path, path)


def test_size_of_a_token_is_limited(tmp_path):
    (tmp_path / "a").write_bytes(b"a" * 10_000_000)
    with pytest.raises(ValueError, match="is larger than 4,096 bytes"):
        read_token(str(tmp_path / "a"))


@pytest.mark.parametrize("name", ["a.mcap", "a.mcap.zstd"])
def test_file_of_a_bag_must_be_regular(endless, name):
    with pytest.raises(ValueError, match="is not a regular file"):
        Bag(endless(name))


@pytest.mark.parametrize("name", ["a.csv", "a.parquet"])
def test_file_of_a_table_must_be_regular(endless, name):
    with pytest.raises(ValueError, match="is not a regular file"):
        read_columns(endless(name))


@pytest.mark.parametrize(
    "words",
    [
        ["estimate", "a.mcap"],
        ["info", "a.mcap"],
        ["recover", "a.mcap", "-o", "b.mcap"],
        ["check", "a.csv"],
        ["check", "a.db3"],
        ["import", SAMPLE, "--mapping", "a.yaml", "-o", "b.mcap"],
        ["estimate", SAMPLE, "--calibration", "a.yaml"],
        ["moves", "a.csv", "--mapping", "a.yaml", "--limit", "1.5"],
        ["report", "a.mcap", "-o", "b.html"],
        ["predict", "a.mcap"],
        ["plot", "a.mcap", "-o", "b.png"],
        ["verify", "a.mcap"],
    ],
    ids=lambda words: " ".join(map(str, words[:3])),
)
def test_commands_refuse_endless_files(endless, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    for name in {str(word) for word in words if str(word).startswith("a.")}:
        endless(name)
    done = ema(*words)
    assert done.exit_code in (1, 2)
    assert "is not a regular file" in done.output


def test_huge_list_is_refused_as_a_calibration_by_its_size(tmp_path):
    (tmp_path / "a.yaml").write_bytes(b"- 1.25\n" * 900_000)
    with pytest.raises(ValueError, match="is larger than 5,000,000 bytes"):
        load_calibration(tmp_path / "a.yaml")
