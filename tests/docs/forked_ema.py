# SPDX-License-Identifier: Apache-2.0
"""Server for ``ema`` in the shells of tests: forks of a process that has imported everything.

The argument of the program is the path of its socket.
"""

import json
import os
import socket
import sys
import traceback
from pathlib import Path
from tempfile import TemporaryDirectory

from ema_cli.main import main

CLIENT = """#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as connection:
    connection.connect({path!r})
    words = json.dumps([os.getcwd(), *sys.argv[1:]]).encode()
    socket.send_fds(connection, [words], [0, 1, 2])
    sys.exit(connection.recv(1)[0])
"""


def serve(path: str) -> None:
    """Run the command lines of clients, one after the other."""
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen()
        while True:
            connection, _ = server.accept()
            with connection:
                words, files, *_ = socket.recv_fds(connection, 1 << 16, 3)
                process = os.fork()
                if process == 0:
                    os._exit(run(*json.loads(words), files=files))
                for file in files:
                    os.close(file)
                _, status = os.waitpid(process, 0)
                connection.send(bytes([os.waitstatus_to_exitcode(status)]))


def run(folder: str, *arguments: str, files: list[int]) -> int:
    """Run a command line in a folder with the client's standard files. Return its exit code."""
    for number, file in enumerate(files):
        os.dup2(file, number)
    os.chdir(folder)
    try:
        main(arguments, prog_name="ema")
    except SystemExit as end:
        return int(end.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
    return 1


def warm_up() -> None:
    """Import the modules of the commands, and load their kernels."""
    with TemporaryDirectory() as folder:
        bag = Path(folder, "bag.mcap")
        for words in (
            ("simulate", "-o", bag),
            ("calibrate", bag, "-o", Path(folder, "unit.yaml")),
            ("estimate", bag),
            ("plot", bag, "--window", "0", "-o", Path(folder, "fit.png")),
            ("report", bag, "-o", Path(folder, "page.html")),
            ("import", "--help"),
            ("label", "--help"),
        ):
            main([str(word) for word in words], prog_name="ema", standalone_mode=False)


if __name__ == "__main__":
    warm_up()
    serve(sys.argv[1])
