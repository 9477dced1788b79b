#!/usr/bin/env python3
"""Find words in what users read that a reader of plain technical English stumbles over.

Read are README, the pages of docs, the comments of ROS messages, and texts in Python: messages,
descriptions of parameters, and the help of commands; other docstrings are left out, and so is code
in a page. Prints a line for each word, and fails where there is one.
"""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
BETTER: Final = {
    r"hears?|heard": "receive, subscribe",
    r"tells?|told": "report, show, separate, name",
    r"lets? go|gives? up": "drop, stop",
    r"gets? on|got on": "continue",
    r"be had": "be read, exist",
    r"that of|those of|of which": "the noun again",
    r"no longer(?! than)": "what holds now",
}
BANNED: Final = {re.compile(rf"\b(?:{words})\b", re.I): use for words, use in BETTER.items()}
COMMAND: Final = re.compile(r"\.(command|group)\b")
CODE: Final = re.compile(r"^```.*?^```|`[^`\n]*`", re.DOTALL | re.MULTILINE)


def texts_of(path: Path) -> Iterator[tuple[int, str]]:
    """Yield what users read of a file, and the line at which it begins."""
    content = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        # What is left out keeps its lines.
        yield 1, CODE.sub(lambda code: "\n" * code[0].count("\n"), content)
    elif path.suffix != ".py":
        yield 1, content
    else:
        nodes = list(ast.walk(ast.parse(content)))
        # A text that stands alone is a docstring; that of a command is its help.
        alone = {node.value for node in nodes if isinstance(node, ast.Expr)}
        alone -= {
            text for node in nodes if isinstance(node, ast.FunctionDef) for text in _help(node)
        }
        for node in nodes:
            match node:
                case ast.Constant(value=str(text), lineno=line) if node not in alone:
                    yield line, text
                case _:
                    pass


def _help(function: ast.FunctionDef) -> list[ast.expr]:
    """Return the docstring of a command."""
    is_command = any(COMMAND.search(ast.unparse(one)) for one in function.decorator_list)
    first = function.body[0]
    return [first.value] if is_command and isinstance(first, ast.Expr) else []


def main() -> int:
    """Print each word that is found; return 1 where there is one."""
    patterns = ("README.md", "docs/*.md", "ema_interfaces/*/*", "ema_*/*.py", "ros2_ws/src/*.py")
    listed = subprocess.run(
        ["git", "ls-files", *patterns],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        encoding="utf-8",
    )
    found = 0
    for name in listed.stdout.split():
        for begins, text in texts_of(ROOT / name):
            for pattern, use in BANNED.items():
                for match in pattern.finditer(text):
                    line = begins + text.count("\n", 0, match.start())
                    print(f"{name}:{line}: {match[0]!r}: write {use}")
                    found += 1
    return int(found > 0)


if __name__ == "__main__":
    sys.exit(main())
