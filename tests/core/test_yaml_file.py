# SPDX-License-Identifier: Apache-2.0
"""YAML files and regular files: accepted content, and files refused by name."""

import os
from pathlib import Path

import pytest

from ema_core import yaml_file
from ema_core.files import read_regular_file
from ema_core.yaml_file import load_yaml


@pytest.fixture
def load(tmp_path):
    def of(text: str | bytes):
        path = tmp_path / "given.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_yaml(path)

    return of


def test_plain_values_are_read(load):
    text = "a: [1, -2.5, null]\nb: {c: yes, d: text}\ne: &x [1]\nf: *x\ng: 0x1F\n"
    expected = {"a": [1, -2.5, None], "b": {"c": True, "d": "text"}, "e": [1], "f": [1], "g": 31}
    assert load(text) == expected
    assert load("h: {<<: {i: 1}, i: 2}") == {"h": {"i": 2}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[", "is not a YAML file: while parsing a flow node"),
        ("a: 1\n b: 2\n", "at line 2, column 3"),
        (b"\xff\xfe\xfa", "is not a YAML file"),
        ("a: 1\nb: 2\na: 3\n", "a is repeated"),
        ("x: {b: 1, b: 1}", "b is repeated"),
        (f"a: {10**400}", "a number of 401 digits: expected at most 64 bits"),
        (f"a: {2**63}", "9223372036854775808: expected at most 64 bits"),
        ("[" * 100_000 + "]" * 100_000, "nested too deeply"),
        ("- " * 100_000, "nested too deeply"),
        ("".join(" " * n + "a:\n" for n in range(1000)), "nested too deeply"),
        ("a: !!python/object/apply:os.system [ls]", "is not a YAML file"),
    ],
)
def test_misleading_or_harmful_text_is_refused_with_the_file(load, text, words):
    with pytest.raises(ValueError, match=r"given\.yaml is not a YAML file") as caught:
        load(text)
    assert words in str(caught.value)


def test_few_bytes_that_expand_to_very_much_are_refused(load):
    rows = [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 12)]
    with pytest.raises(ValueError, match="more than 5,000,000 values"):
        load("\n".join(["a0: &a0 [1, 2, 3]", *rows]))


def test_only_regular_files_of_limited_size_are_read(tmp_path, monkeypatch):
    pipe = tmp_path / "pipe.yaml"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path, Path("/dev/zero")):
        with pytest.raises(ValueError, match="is not a regular file"):
            read_regular_file(path, 1000)
    file = tmp_path / "file"
    file.write_bytes(b"12345")
    assert read_regular_file(file, 5) == b"12345"
    with pytest.raises(ValueError, match="is larger than 4 bytes"):
        read_regular_file(file, 4)
    with pytest.raises(FileNotFoundError):
        read_regular_file(tmp_path / "nothing", 4)
    monkeypatch.setattr(yaml_file, "MOST_BYTES", 4)
    with pytest.raises(ValueError, match="is larger than 4 bytes"):
        load_yaml(file)


@pytest.mark.parametrize("value", ["!!timestamp x", "!!int ''", "!!bool maybe", "!!float [1]"])
def test_tag_that_contradicts_its_value_is_refused(tmp_path, value):
    path = tmp_path / "a.yaml"
    path.write_text(f"friction: {value}\n")
    with pytest.raises(ValueError, match=r"a\.yaml is not a YAML file"):
        load_yaml(path)
