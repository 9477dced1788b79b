# SPDX-License-Identifier: Apache-2.0
"""A command never overwrites its input, and overwrites other files only with ``--replace``."""

from pathlib import Path

import pytest

from ema_cli.output import require_free

from ..commands import SAMPLE


@pytest.fixture(scope="module")
def folder(ema, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a recording of a healthy cycle, `bag`, a description and a mapping."""
    path = tmp_path_factory.mktemp("healthy")
    assert ema("simulate", "-o", path / "bag").exit_code == 0
    (path / "unit.yaml").write_text("actuator_id: flap\n")
    (path / "mapping.yaml").write_text("position: a\ncommand: b\nclock: {source: c}\n")
    return path


@pytest.mark.parametrize("link", [None, Path.symlink_to, Path.hardlink_to])
def test_input_is_recognised_by_any_name_of_the_file(tmp_path: Path, link):
    member = tmp_path / "bag" / "bag_0.mcap"
    member.parent.mkdir()
    member.touch()
    output = tmp_path / "link.yaml" if link else member
    if link:
        link(output, member)
    for candidate in (member.parent, member):
        for overwrite in (False, True):
            with pytest.raises(ValueError, match="is the same as the input"):
                require_free(output, [candidate], overwrite=overwrite)


@pytest.mark.parametrize(
    ("words", "read"),
    [
        (("calibrate", "bag"), "bag/bag_0.mcap"),
        (("calibrate", "bag", "--actuator", "unit.yaml"), "unit.yaml"),
        (("recover", "bag"), "bag/bag_0.mcap"),
        (("recover", "bag/bag_0.mcap"), "bag/bag_0.mcap"),
        (("import", "bag", "--mapping", "mapping.yaml"), "mapping.yaml"),
    ],
)
def test_command_never_overwrites_its_input(ema, folder: Path, monkeypatch, words, read):
    monkeypatch.chdir(folder)
    content = Path(read).read_bytes()
    result = ema(*words, "-o", read, "--replace")
    assert (result.exit_code, "choose another name" in result.stderr) == (1, True), result.stderr
    assert Path(read).read_bytes() == content
    assert not list(folder.rglob("*.partial"))


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (("simulate",), "a.mcap"),
        (("report", SAMPLE), "a.html"),
        (("calibrate", "BAG"), "a.txt"),
        (("plot", SAMPLE), "a.png"),
        (("predict", SAMPLE, "--hours-per-cycle", "10"), "a.png"),
    ],
)
def test_other_files_are_overwritten_only_on_request(
    ema, folder: Path, tmp_path: Path, arguments: tuple, name: str
):
    existing = tmp_path / name
    existing.write_text("keep me")
    command = (
        *(folder / "bag" if argument == "BAG" else argument for argument in arguments),
        "-o",
        existing,
    )
    refused = ema(*command)
    assert (refused.exit_code, "--replace" in refused.stderr) == (1, True)
    assert existing.read_text() == "keep me"
    assert ema(*command, "--replace").exit_code == 0
    assert existing.stat().st_size > 100
