#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Write the software bill of materials (CycloneDX 1.6, JSON) of the installation.

    tools/in_venv.sh sbom python tools/sbom.py ema.cdx.json

It lists the packages in ``.venv`` with licences and dependencies, as reported by cyclonedx-py, the
packages bundled in the dashboard's page, and the packages of this repository. It fails if a locked
package is missing.
"""

import base64
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any, Final

from cyclonedx.schema import SchemaVersion  # pyright: ignore[reportMissingImports]
from cyclonedx.validation.json import JsonStrictValidator  # pyright: ignore[reportMissingImports]

ROOT: Final = Path(__file__).resolve().parents[1]
VENV: Final = ROOT / ".venv"
PAGE: Final = ROOT / "ros2_ws" / "src" / "ema_dashboard" / "web" / "package-lock.json"
# Licences of packages whose wheels do not state it, from their sources.
LICENCES: Final = {
    "atheris": "Apache-2.0",
    "partd": "BSD-3-Clause",
    "ros-fastcdr": "Apache-2.0",
    "ros-fastrtps": "Apache-2.0",
    "ros-jazzy-common-interfaces": "Apache-2.0",
    "ros-jazzy-rclpy": "Apache-2.0",
    "ros-jazzy-rmw-fastrtps-cpp": "Apache-2.0",
    "setuptools": "MIT",
}


def key(name: str) -> str:
    """Return the normalized name of a distribution (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def installed() -> dict[str, Any]:
    """Return the bill of materials of ``.venv``, without duplicate metadata.

    Each ROS wheel contains metadata of a second package, which is not a distribution. If an
    installed version differs from the locked version, the program exits with a message.
    """
    command = [str(Path(sys.executable).with_name("cyclonedx-py")), "environment"]
    command += ["--output-reproducible", "--spec-version", "1.6", str(VENV / "bin" / "python")]
    bill = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    text = (VENV / "lock.txt").read_text(encoding="utf-8")
    locked = dict(re.findall(r"^([^\s#=]+)==(\S+)", text, re.MULTILINE))
    versions = {key(item["name"]): item["version"] for item in bill["components"]}
    wrong = [f"{name} {locked[name]}" for name in locked if versions.get(name) != locked[name]]
    if wrong:
        sys.exit(
            f"sbom: installed versions differ from the locked versions: {', '.join(wrong)}; run "
            "`make setup`"
        )
    kept = [item for item in bill["components"] if key(item["name"]) in {*locked, "pip"}]
    refs = {item["bom-ref"] for item in kept}
    bill["components"] = kept
    bill["dependencies"] = [
        {**item, "dependsOn": [ref for ref in item.get("dependsOn", []) if ref in refs]}
        for item in bill["dependencies"]
        if item["ref"] in refs
    ]
    for item in kept:
        if "licenses" not in item and item["name"].startswith("ros-"):
            item["licenses"] = licences_of(item["name"].removeprefix("ros-").replace("-", "_"))
        if not item.get("licenses") and item["name"] in LICENCES:
            item["licenses"] = [{"license": {"id": LICENCES[item["name"]]}}]
    unknown = [item["name"] for item in kept if not item.get("licenses")]
    if unknown:
        sys.exit(f"sbom: unknown licence of {', '.join(unknown)}; add it in tools/sbom.py")
    return bill


def licences_of(package: str) -> list[dict[str, Any]]:
    """Return the licences in the manifest of a ROS package; empty if it is not installed.

    The wheel of the package does not state them.
    """
    manifest = VENV / "share" / package / "package.xml"
    if not manifest.exists():
        return []
    texts = [item.text for item in ElementTree.parse(manifest).iter("license") if item.text]
    return [{"license": {"name": text.strip()}} for text in texts]


def bundled() -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the packages bundled in the dashboard's page, and their dependencies."""
    packages = json.loads(PAGE.read_text(encoding="utf-8"))["packages"]
    shipped = {
        path.rpartition("node_modules/")[2]: item
        for path, item in packages.items()
        if path and not item.get("dev")
    }
    purls = {
        name: f"pkg:npm/{name.replace('@', '%40')}@{item['version']}"
        for name, item in shipped.items()
    }
    components = [
        {
            "type": "library",
            "bom-ref": purls[name],
            "name": name,
            "version": item["version"],
            "purl": purls[name],
            "licenses": [{"license": {"id": item["license"]}}],
            "hashes": [{"alg": "SHA-512", "content": _hexadecimal(item["integrity"])}],
        }
        for name, item in shipped.items()
    ]
    dependencies = [
        {
            "ref": purls[name],
            "dependsOn": sorted(purls[needed] for needed in item.get("dependencies", {})),
        }
        for name, item in shipped.items()
    ]
    return components, dependencies


def _hexadecimal(integrity: str) -> str:
    algorithm, _, digest = integrity.partition("-")
    if algorithm != "sha512":
        raise ValueError(f"{PAGE}: integrity {integrity!r}: expected sha512-...")
    return base64.b64decode(digest).hex()


def repository_packages() -> list[dict[str, Any]]:
    """Return the packages of this repository, from their manifests."""
    components = []
    manifests = [*ROOT.glob("ema_*/package.xml"), *ROOT.glob("ros2_ws/src/ema_*/package.xml")]
    for path in sorted(manifests):
        manifest = ElementTree.parse(path).getroot()
        values = {name: manifest.findtext(name, "") for name in ("name", "version", "description")}
        licence = [{"license": {"id": manifest.findtext("license", "")}}]
        components.append(
            {"type": "library", "bom-ref": values["name"], **values, "licenses": licence}
        )
    return components


def main() -> None:
    """Write the bill of materials to the file given on the command line."""
    output = Path(sys.argv[1])
    bill = installed()
    page, page_dependencies = bundled()
    packages = repository_packages()
    bill["components"] += [*page, *packages]
    bill["dependencies"] += page_dependencies
    bill["metadata"]["component"] = {
        "type": "application",
        "bom-ref": "ema-health-monitor",
        "name": "EMA health monitor",
        "version": packages[0]["version"],
        "licenses": packages[0]["licenses"],
    }
    text = json.dumps(bill, indent=2, ensure_ascii=False) + "\n"
    error = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    if error:
        sys.exit(f"sbom: not valid CycloneDX 1.6: {error}")
    output.write_text(text, encoding="utf-8")
    print(f"{output}: {len(bill['components'])} components, {len(page)} of them in the page")


if __name__ == "__main__":
    main()
