# SPDX-License-Identifier: Apache-2.0
"""The packaged page agrees with the registries and messages; no browser is needed."""

import json
from importlib.resources import files
from pathlib import Path
from runpy import run_path

ROOT = Path(__file__).parents[2]
WEB = ROOT / "ros2_ws/src/ema_dashboard/web"


def test_the_page_knows_faults_causes_and_messages_as_they_are_defined():
    writer = run_path(str(ROOT / "tools" / "page_registry.py"))
    assert json.loads(writer["FILE"].read_text()) == writer["registry"](), "run `make page`"
    assert writer["INTERFACES"].read_text() == writer["interfaces"](), "run `make page`"


def test_the_shipped_page_names_no_other_host():
    for file in files("ema_dashboard").joinpath("page").iterdir():
        content = file.read_bytes()
        if file.name.endswith((".html", ".css")):
            assert b"//" not in content.replace(b"/*", b""), f"{file.name} names an address"


def test_the_lock_of_the_packages_names_no_addresses():
    lock = json.loads((WEB / "package-lock.json").read_text())
    assert all("resolved" not in package for package in lock["packages"].values())
