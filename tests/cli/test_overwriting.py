"""A command never writes onto what it reads, and onto other files only when it is forced to."""

from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def healthy(ema, tmp_path: Path) -> Path:
    """Return a folder of a recording of one healthy cycle."""
    path = tmp_path / "healthy"
    assert ema("simulate", "-o", path).exit_code == 0
    return path


def by_its_name(folder: Path, member: Path) -> Path:
    return member


def by_a_symbolic_link(folder: Path, member: Path) -> Path:
    link = folder.parent / "link.yaml"
    link.symlink_to(member)
    return link


def by_a_hard_link(folder: Path, member: Path) -> Path:
    link = folder.parent / "link.yaml"
    link.hardlink_to(member)
    return link


@pytest.mark.parametrize("named", [by_its_name, by_a_symbolic_link, by_a_hard_link])
@pytest.mark.parametrize("given", ["folder", "file"])
def test_calibration_never_replaces_its_own_input(
    ema, healthy: Path, named: Callable[[Path, Path], Path], given: str
):
    member = healthy / "healthy_0.mcap"
    content = member.read_bytes()
    output = named(healthy, member)
    bag = healthy if given == "folder" else member
    for force in ((), ("--replace",)):
        result = ema("calibrate", bag, "-o", output, *force)
        assert (result.exit_code, "is the input" in result.stderr) == (1, True)
        assert member.read_bytes() == content
    assert not list(healthy.parent.rglob("*.partial"))


def test_calibration_replaces_another_file_only_by_force(ema, healthy: Path, tmp_path: Path):
    other = tmp_path / "notes.txt"
    other.write_text("keep me")
    refused = ema("calibrate", healthy, "-o", other)
    assert (refused.exit_code, "--replace" in refused.stderr) == (1, True)
    assert other.read_text() == "keep me"
    assert ema("calibrate", healthy, "-o", other, "--replace").exit_code == 0
    assert "correction" in other.read_text()


def test_calibration_never_replaces_the_description_it_reads(ema, healthy: Path, tmp_path: Path):
    unit = tmp_path / "unit.yaml"
    unit.write_text("actuator_id: flap\n")
    result = ema("calibrate", healthy, "--actuator", unit, "-o", unit, "--replace")
    assert (result.exit_code, unit.read_text()) == (1, "actuator_id: flap\n")


def test_recovery_never_replaces_a_file_of_its_input(ema, healthy: Path):
    member = healthy / "healthy_0.mcap"
    content = member.read_bytes()
    assert ema("recover", healthy, "-o", member, "--replace").exit_code == 1
    assert member.read_bytes() == content
