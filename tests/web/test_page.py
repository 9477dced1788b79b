# SPDX-License-Identifier: Apache-2.0
"""Tests of the packaged page and its sources that need no browser."""

import json
import re
from importlib.resources import files
from pathlib import Path
from runpy import run_path

from ema_core.event_kinds import EventKind

ROOT = Path(__file__).parents[2]
WEB = ROOT / "ros2_ws/src/ema_dashboard/web"


def test_page_has_the_registered_faults_and_causes_and_the_message_types():
    writer = run_path(str(ROOT / "tools" / "page_registry.py"))
    assert json.loads(writer["FILE"].read_text()) == writer["registry"](), "run `make page`"
    assert writer["INTERFACES"].read_text() == writer["interfaces"](), "run `make page`"


def test_page_has_a_sign_for_each_kind_of_event():
    source = (WEB / "src/views/events.tsx").read_text()
    kinds = re.findall(r"^  (\w+): \{ sign:", source, re.MULTILINE)
    assert [*kinds, EventKind.OTHER] == list(EventKind)


def test_packaged_page_refers_to_no_external_host():
    for file in files("ema_dashboard").joinpath("page").iterdir():
        content = file.read_bytes()
        if file.name.endswith((".html", ".css")):
            assert b"//" not in content.replace(b"/*", b""), f"{file.name} contains an address"


def test_lock_file_of_the_page_has_no_addresses():
    lock = json.loads((WEB / "package-lock.json").read_text())
    assert all("resolved" not in package for package in lock["packages"].values())
