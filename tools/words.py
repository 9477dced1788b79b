#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Find words that are not plain technical English.

All texts, such as documents, ROS messages and string literals of Python sources, are checked
against ``IN_TEXTS``. Prose, which is everything except string literals, is also checked against
``IN_PROSE``, documents against ``IN_DOCUMENTS``, and local names against ``NAMES``. Code in
Markdown and docstrings is ignored. Prints a line per finding, and exits with 1 if there are any.
"""

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
IN_TEXTS: Final = {
    r"hears?|heard": "receive, subscribe",
    r"tells?|told": "report, show, separate, name",
    r"lets? go|gives? up": "drop, stop",
    r"gets? on|got on": "continue",
    r"be had": "be read, exist",
    r"that of|those of|of which": "the noun again",
    r"no longer(?! than)": "what holds now",
}
"""Replacements for all texts, keyed by pattern."""

IN_PROSE: Final = {
    r"says?|said": "state, report, show",
    r"goes on|going on|gone on": "continue",
    r"takes? for|taken for": "interpret as, mistake for",
    r"looks? for|looked for": "search",
    r"is there already|is there twice": "exists already, is repeated",
    r"returns? what|by how much|what (?:is|was|are|were|has|have)": "a noun",
    r"those that|that one|so many": "the noun again",
    r"as of(?= `)": "the description itself: a docstring stands alone",
    r"beside": "next to, together with, in addition to",
    r"whatever": "for any",
    r"in words": "as a text",
    r"to and fro": "back and forth",
    r"anew": "again",
    r"thrice": "three times",
    r"of ours": "the name of the package",
    r"nobody|somebody": "the subject, or the passive",
}
"""Replacements for docstrings, comments, documents and ROS messages, keyed by pattern."""

IN_DOCUMENTS: Final = {
    r"alike": "in the same way, equal, similar",
    r"as many as": "the number",
    r"(?:other|another) makes?": "manufacturer",
    r"to the bit": "bit-identical",
    r"will do": "is sufficient",
}
"""Further replacements for documents, keyed by pattern."""

NAMES: Final = frozenset(
    ("one", "found", "said", "told", "own", "other", "others", "known", "given", "heard")
)
"""Names of variables that are not nouns of the field."""

UNTREATED: Final[tuple[str, ...]] = ()
"""Paths whose docstrings, comments and names are not checked yet."""

PATTERNS: Final = (
    *("*.md", "*.sql", "*.toml", "*.yaml", "Makefile", "ema_interfaces/*/*", "ema_*/*.py"),
    *("ros2_ws/src/*.py", "ros2_ws/src/ema_dashboard/web/src/*.ts*"),
    *("benchmarks/*.py", "tests/*.py", "tools/*.py"),
    # This file and its tests contain the words.
    *(":!tools/words.py", ":!tests/harness/test_words.py"),
)
COMMAND: Final = re.compile(r"\.(command|group)\b")
FENCE: Final = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
CODE: Final = re.compile(r"``[^`]*``|`[^`\n]*`")
# Titles may be questions: "What is installed".
TITLE: Final = re.compile(r"^#.*|\*\*[^*\n]+\*\*", re.MULTILINE)
HEADING: Final = re.compile(r"<h\d>.*</h\d>")


class Finding(NamedTuple):
    """A word to replace, with its line and a replacement."""

    line: int
    word: str
    better: str


def findings(name: str, content: str) -> list[Finding]:
    """Return the words to replace in a file, in order of lines.

    Parameters
    ----------
    name
        Path of the file relative to the repository.
    content
        Content of the file.
    """
    if not name.endswith(".py"):
        if not name.endswith(".md"):
            return sorted(_matches(1, HEADING.sub("", content), IN_TEXTS | IN_PROSE))
        text = _without_code(content)
        prose = TITLE.sub("", text)
        return sorted([*_matches(1, text, IN_TEXTS), *_matches(1, prose, IN_PROSE | IN_DOCUMENTS)])
    tree = ast.parse(content)
    docstrings = _docstrings(tree)
    replace = [
        finding
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if node not in docstrings
        for finding in _matches(node.lineno, node.value, IN_TEXTS)
    ]
    if not name.startswith(UNTREATED):
        remarks = [(node.lineno, str(node.value)) for node in docstrings]
        for line, text in (*remarks, *_comments(content)):
            replace += _matches(line, _without_code(text), IN_TEXTS | IN_PROSE)
        replace += _variables(tree)
    return sorted(replace)


def _variables(tree: ast.Module) -> Iterator[Finding]:
    """Yield the variables and arguments whose names are in ``NAMES``."""
    nodes = list(ast.walk(tree))
    # The fields of a class may have the names of a message's fields.
    classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
    fields = {
        item.target for node in classes for item in node.body if isinstance(item, ast.AnnAssign)
    }
    for node in nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node not in fields:
            line, name = node.lineno, node.id
        elif isinstance(node, ast.arg) and node.arg != "other":
            # Methods that override a method of Python or numba inherit "other".
            line, name = node.lineno, node.arg
        else:
            continue
        if name in NAMES:
            yield Finding(line, name, "the noun of the field")


def _matches(begin: int, text: str, better: Mapping[str, str]) -> list[Finding]:
    """Return the findings in a text, whose first line has the number ``begin``."""
    return [
        Finding(begin + text.count("\n", 0, match.start()), match[0], words)
        for pattern, words in better.items()
        for match in re.finditer(rf"\b(?:{pattern})\b", text, re.IGNORECASE)
    ]


def _without_code(text: str) -> str:
    """Return a text with its code blanked; line numbers and backticks remain."""
    text = FENCE.sub(lambda code: "\n" * code[0].count("\n"), text)
    return CODE.sub(lambda code: "`" + "\n" * code[0].count("\n") + "`", text)


def _docstrings(tree: ast.Module) -> set[ast.Constant]:
    """Return the string literals that are statements, without the help of commands."""
    nodes = list(ast.walk(tree))
    helps = {
        node.body[0]
        for node in nodes
        if isinstance(node, ast.FunctionDef)
        if any(COMMAND.search(ast.unparse(item)) for item in node.decorator_list)
    }
    return {
        node.value
        for node in nodes
        if isinstance(node, ast.Expr) and node not in helps
        if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    }


def _comments(content: str) -> Iterator[tuple[int, str]]:
    for token in tokenize.generate_tokens(io.StringIO(content).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def main() -> int:
    """Print each word to replace; return 1 if there are any, else 0."""
    listed = subprocess.run(
        ["git", "ls-files", *PATTERNS],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        encoding="utf-8",
    )
    lines = [
        f"{name}:{line}: {word!r}: write {better}"
        for name in listed.stdout.split()
        for line, word, better in findings(name, (ROOT / name).read_text(encoding="utf-8"))
    ]
    print(*lines, sep="\n", end="\n" * bool(lines))
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())
