# SPDX-License-Identifier: Apache-2.0
"""Find calls that read or write text in the encoding of the locale."""

import ast
from collections.abc import Iterator

_RUN = ("run", "Popen", "check_output", "check_call", "call")


def calls_without_encoding(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and name of each call in a module that does not specify the encoding of text."""
    for call in ast.walk(ast.parse(source)):
        if not isinstance(call, ast.Call):
            continue
        name = getattr(call.func, "attr", getattr(call.func, "id", ""))
        keywords = {keyword.arg for keyword in call.keywords}
        if "encoding" in keywords or None in keywords:
            continue
        if _is_text(call, name, keywords):
            yield call.lineno, name


def _is_text(call: ast.Call, name: str, keywords: set[str | None]) -> bool:
    is_method = isinstance(call.func, ast.Attribute)
    if name == "read_text":
        return not call.args
    if name == "write_text":
        return len(call.args) < 2
    if name == "open":
        return _opens_text(call, 0 if is_method else 1)
    if name in ("NamedTemporaryFile", "TemporaryFile", "fdopen"):
        return _opens_text(call, 1 if name == "fdopen" else 0, default="w+b")
    if name in _RUN:
        names = ("text", "universal_newlines")
        values = [keyword.value for keyword in call.keywords if keyword.arg in names]
        return any(isinstance(value, ast.Constant) and value.value for value in values)
    return False


def _opens_text(call: ast.Call, place: int, default: str = "r") -> bool:
    """Return whether a call opens a file as text; the mode is its argument number ``place``."""
    modes = [keyword.value for keyword in call.keywords if keyword.arg == "mode"]
    modes += call.args[place : place + 1]
    if not modes:
        return "b" not in default and not (place == 0 and call.args)
    [mode, *_] = modes
    if not isinstance(mode, ast.Constant) or not isinstance(mode.value, str):
        return False
    return "b" not in mode.value and set(mode.value) <= set("rwax+t")
