# SPDX-License-Identifier: Apache-2.0
"""The packaged page agrees with the registries and messages; no browser is needed."""

import json
from importlib.resources import files
from pathlib import Path
from runpy import run_path

ROOT = Path(__file__).parents[2]
WEB = ROOT / "ros2_ws/src/ema_dashboard/web"


def test_page_has_the_defined_faults_causes_and_messages():
    writer = run_path(str(ROOT / "tools" / "page_registry.py"))
    assert json.loads(writer["FILE"].read_text()) == writer["registry"](), "run `make page`"
    assert writer["INTERFACES"].read_text() == writer["interfaces"](), "run `make page`"


def test_packaged_page_refers_to_no_other_host():
    for file in files("ema_dashboard").joinpath("page").iterdir():
        content = file.read_bytes()
        if file.name.endswith((".html", ".css")):
            assert b"//" not in content.replace(b"/*", b""), f"{file.name} names an address"


def test_lock_file_of_the_page_has_no_addresses():
    lock = json.loads((WEB / "package-lock.json").read_text())
    assert all("resolved" not in package for package in lock["packages"].values())
