# SPDX-License-Identifier: Apache-2.0
"""The commands and code in README and guides produce the output that is shown.

Blocks of ``python`` in a document run one after the other, and so do blocks of ``sh``, in a
temporary folder. A block of ``text`` after a block is its output. Words must be equal, numbers
agree to a few per cent. A line that ends in ``...`` shows only the beginning. ``<!-- not run:
reason -->`` before a block skips it, and ``<!-- long: reason -->`` runs it only in tests marked
``long``.
"""

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from ..waiting import started, wait_for
from .forked_ema import CLIENT

ROOT = Path(__file__).parents[2]
GUIDES = (
    *("install", "first-diagnosis", "your-csv", "your-robot"),
    *("describe-actuator", "plan-a-test", "ordinary-motion", "predict-life", "report", "run-nodes"),
    *("python", "command-line", "real-data", "study"),
)

DOCUMENTS = ["README.md", *(f"docs/{name}.md" for name in GUIDES)]
BLOCK = re.compile(
    r"(?P<mark><!-- (?:not run|long): [^\n]+ -->\n)?"
    r"^```(?P<kind>python|sh|text)\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
SHOWN_AS = {"MPLBACKEND": "agg", "COLUMNS": "80"}
FIGURE = re.compile(r"-?\d+(?:\.\d+)?")


class Snippet(NamedTuple):
    line: int
    kind: str
    text: str
    output: str


def snippets(document: Path, kind: str, *, with_long: bool = False) -> list[Snippet]:
    """Return the blocks of a kind that run, each with the output that the document shows."""
    text = document.read_text(encoding="utf-8")
    blocks: list[Snippet] = []
    is_run = False
    for match in BLOCK.finditer(text):
        if match["kind"] != "text":
            is_long = (match["mark"] or "").startswith("<!-- long")
            is_run = match["kind"] == kind and (match["mark"] is None or (with_long and is_long))
            if is_run:
                line = text.count("\n", 0, match.start()) + 1
                blocks.append(Snippet(line, kind, match["text"], ""))
        elif is_run:
            blocks[-1] = blocks[-1]._replace(output=match["text"])
    return blocks


def assert_shown(snippet: Snippet, output: str) -> None:
    """Compare an output with the shown output: words exactly, numbers approximately."""
    shown = [line for line in snippet.output.splitlines() if line.strip()]
    actual = [line for line in output.splitlines() if line.strip()]
    assert len(actual) == len(shown), output
    for expected, line in zip(shown, actual, strict=True):
        is_open = expected.endswith("...")
        words = FIGURE.split(expected.removesuffix("..."))
        rest = FIGURE.split(line)[: len(words)]
        if is_open:
            rest[-1] = rest[-1][: len(words[-1])]
        assert [" ".join(w.split()) for w in rest] == [" ".join(w.split()) for w in words], line
        figures = [float(figure) for figure in FIGURE.findall(expected)]
        assert [float(f) for f in FIGURE.findall(line)][: len(figures)] == pytest.approx(
            figures, rel=0.03, abs=5e-4
        ), line


@pytest.fixture(scope="module")
def quick_ema(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return a folder with an ``ema`` that does not import everything at each call."""
    folder = tmp_path_factory.mktemp("bin")
    client, path = folder / "ema", folder / "socket"
    client.write_text(CLIENT.format(python=sys.executable, path=str(path)))
    client.chmod(0o755)
    program = Path(__file__).with_name("forked_ema.py")
    environment = os.environ | SHOWN_AS
    with started(
        [sys.executable, program, path], env=environment, stdout=subprocess.DEVNULL
    ) as server:
        wait_for(lambda: path.exists() or server.poll() is not None, "the server of ema")
        yield folder


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(ROOT / "bags", tmp_path / "bags")
    monkeypatch.chdir(tmp_path)
    for name, value in SHOWN_AS.items():
        monkeypatch.setenv(name, value)
    return tmp_path


@pytest.mark.parametrize("name", DOCUMENTS)
def test_python_in_the_document_prints_the_shown_output(workplace, name):
    names: dict[str, object] = {}
    for snippet in snippets(ROOT / name, "python"):
        printed = io.StringIO()
        # Empty lines, so that a traceback names the line of the document.
        source = "\n" * snippet.line + snippet.text
        with contextlib.redirect_stdout(printed):
            exec(compile(source, name, "exec"), names)
        if snippet.output:
            assert_shown(snippet, printed.getvalue())


@pytest.mark.parametrize("name", DOCUMENTS)
def test_shell_commands_in_the_document_print_the_shown_output(workplace, quick_ema, name):
    run_shell(name, snippets(ROOT / name, "sh"), quick_ema)


@pytest.mark.long
@pytest.mark.parametrize("name", ["docs/first-diagnosis.md", "docs/plan-a-test.md"])
def test_long_shell_commands_print_the_shown_output(workplace, quick_ema, name):
    """They run with the commands before them, whose files they need."""
    blocks = snippets(ROOT / name, "sh", with_long=True)
    assert len(blocks) > len(snippets(ROOT / name, "sh"))
    run_shell(name, blocks, quick_ema)


def run_shell(name: str, blocks: list[Snippet], quick_ema: Path) -> None:
    """Run blocks in a shell one after the other, and compare their outputs."""
    environment = os.environ | {"PATH": f"{quick_ema}:{os.environ['PATH']}"}
    for snippet in blocks:
        command = ["bash", "-euc", snippet.text]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        assert done.returncode == 0, f"{name}, line {snippet.line}: {done.stderr}"
        if snippet.output:
            assert_shown(snippet, done.stdout)


def test_documents_write_files_of_different_names():
    """A reader who follows several documents in a folder never reads another document's bag."""
    writers: dict[str, set[str]] = {}
    for name in DOCUMENTS:
        text = "".join(match["text"] for match in BLOCK.finditer((ROOT / name).read_text()))
        for file in re.findall(r"(?:-o |> |Path\(\")([a-z_]+\.(?:mcap|yaml|html))", text):
            writers.setdefault(file, set()).add(name)
    assert len(writers) > 15
    assert {file: names for file, names in writers.items() if len(names) > 1} == {}


@pytest.mark.parametrize(
    ("name", "kind", "least"),
    [("README.md", "python", 1), ("README.md", "sh", 1), ("docs/python.md", "python", 5)],
)
def test_blocks_are_found_and_run(name, kind, least):
    assert len(snippets(ROOT / name, kind)) >= least


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_block_states_its_language(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    kinds = re.findall(r"^```(\w*)$", text, re.MULTILINE)[::2]
    assert set(kinds) <= {"python", "sh", "text", "yaml", "mermaid"}
