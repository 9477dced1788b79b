# SPDX-License-Identifier: Apache-2.0
"""The word checker reads texts, docstrings, comments and names, but no code."""

import importlib.util
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).resolve().parents[2] / "tools" / "words.py"


@pytest.fixture(scope="module")
def words():
    spec = importlib.util.spec_from_file_location("words", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("README.md", "A line.\nIt tells more.", [(2, "tells")]),
        ("README.md", "```\ntell\n```\n`told` and that of a friend", [(4, "that of")]),
        ("README.md", "A file beside\nanother make.", [(1, "beside"), (2, "another make")]),
        ("README.md", "## What is new\n- **What is wrong**: what is", [(2, "what is")]),
        ("web/src/a.tsx", "<h2>What is wrong</h2>\n// what is", [(2, "what is")]),
        ("Makefile", "lock: ## compile all locks anew", [(1, "anew")]),
        ("ema_interfaces/msg/A.msg", "# what is heard", [(1, "heard"), (1, "what is")]),
        ("ema_core/ema_core/a.py", 'text = "told"', [(1, "told")]),
        (
            "ema_core/ema_core/a.py",
            '"""One.\n\nReturn what is told."""',
            [(3, "Return what"), (3, "told")],
        ),
        ("ema_core/ema_core/a.py", '"""As of ``f``, see `told`."""', [(1, "As of")]),
        ("ema_core/ema_core/a.py", "x = 1\n\n# nobody knows", [(3, "nobody")]),
        ("ema_core/ema_core/a.py", "for one in range(3):\n    pass", [(1, "one")]),
        ("ema_core/ema_core/a.py", "def f(given, other): ...", [(1, "given")]),
        ("ema_core/ema_core/a.py", "one_sided = x.found + one", []),
        (
            "ema_cli/ema_cli/a.py",
            '@click.command()\ndef f():\n    """It tells."""\n    # told\n',
            [(3, "tells")],
        ),
    ],
)
def test_findings_name_line_and_word(words, monkeypatch, name, content, expected):
    monkeypatch.setattr(words, "UNTREATED", ("ema_cli/",))
    assert [(item.line, item.word) for item in words.findings(name, content)] == expected
