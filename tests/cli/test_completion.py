"""The tab key completes commands and options of ``ema``."""

import subprocess

import pytest

ASK = """
eval "$(ema completion bash)"
COMP_WORDS=({words})
COMP_CWORD={at}
_ema_completion ema
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.mark.parametrize(
    ("words", "completed"),
    [(("ema", "esti"), ["estimate"]), (("ema", "archive", "sc"), ["scan"])],
)
def test_bash_completes(words, completed):
    script = ASK.format(words=" ".join(words), at=len(words) - 1)
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.split() == completed, done.stderr
