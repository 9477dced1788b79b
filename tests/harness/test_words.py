"""The check of words reads what users read, and that alone."""

import runpy
from pathlib import Path

import pytest

WORDS = runpy.run_path(str(Path(__file__).parents[2] / "tools" / "words.py"))

PYTHON = '''
"""Told in a docstring."""
PATH = "x"
"""Told of a name."""

@main.command("a")
def a():
    """Tell it in a help."""

def b():
    """Tell it in a docstring."""
    raise ValueError(f"heard {PATH}")
'''
PAGE = """One.
`told` in code.

```text
told in code
```
It is told.
"""


@pytest.mark.parametrize(
    ("name", "content", "found"),
    [
        ("page.md", PAGE, [(7, "told")]),
        ("code.py", PYTHON, [(8, "Tell"), (12, "heard")]),
        ("Health.msg", "uint8 a  # that of b\n", [(1, "that of")]),
    ],
)
def test_words_are_found_where_users_read_them(tmp_path, name, content, found):
    path = tmp_path / name
    path.write_text(content)
    matches = [
        (begins + text.count("\n", 0, match.start()), match[0])
        for begins, text in WORDS["texts_of"](path)
        for pattern in WORDS["BANNED"]
        for match in pattern.finditer(text)
    ]
    assert sorted(matches) == found
