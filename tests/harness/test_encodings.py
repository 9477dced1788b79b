# SPDX-License-Identifier: Apache-2.0
"""Text is UTF-8 in any locale: every call specifies its encoding."""

from pathlib import Path

import pytest

from .encodings import calls_without_encoding

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("ema_*", "ros2_ws/src/*", "tools", "benchmarks")


def test_every_call_specifies_the_encoding_of_text():
    files = [file for folder in FOLDERS for file in ROOT.glob(f"{folder}/**/*.py")]
    assert len(files) > 300
    open_calls = [
        f"{file.relative_to(ROOT)}:{line}: {name}"
        for file in files
        for line, name in calls_without_encoding(file.read_text(encoding="utf-8"))
    ]
    assert open_calls == []


@pytest.mark.parametrize(
    ("line", "is_open"),
    [
        ("path.read_text()", True),
        ("path.read_text(encoding='utf-8')", False),
        ("path.write_text(text)", True),
        ("open(path)", True),
        ("open(path, 'rb')", False),
        ("path.open()", True),
        ("path.open('w')", True),
        ("path.open('wb')", False),
        ("os.open(path, os.O_RDONLY)", False),
        ("subprocess.run(words, text=True)", True),
        ("subprocess.run(words)", False),
    ],
)
def test_calls_of_text_and_binary_files_are_distinguished(line, is_open):
    assert bool(list(calls_without_encoding(line))) == is_open
