# SPDX-License-Identifier: Apache-2.0
"""The tab key completes commands and options of ``ema`` in bash."""

import subprocess

ASK = """
eval "$(ema completion bash)"
complete_last() {
    COMP_WORDS=("$@")
    COMP_CWORD=$(($# - 1))
    COMPREPLY=()
    _ema_completion ema
    printf '%s\\n' "${COMPREPLY[@]}"
}
complete_last ema esti
complete_last ema archive sc
complete_last ema pred
"""


def test_bash_completes():
    done = subprocess.run(["bash", "-c", ASK], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["estimate", "scan", "predict"], done.stderr
