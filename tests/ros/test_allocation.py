"""All threads of a node take memory from one heap, which is given back when it is let go."""

import subprocess
import sys

import pytest

HEAPS = """
import ctypes
import sys
import threading
from ema_ros.allocation import allocate_compactly

if sys.argv[1] == "compactly":
    allocate_compactly()
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
together = threading.Barrier(6)


def take():
    together.wait()
    for _ in range(1000):
        libc.malloc(ctypes.c_size_t(2000))
    together.wait()


threads = [threading.Thread(target=take) for _ in range(6)]
for one in threads:
    one.start()
for one in threads:
    one.join()
libc.fopen.restype = ctypes.c_void_p
libc.fclose.argtypes = [ctypes.c_void_p]
libc.malloc_info.argtypes = [ctypes.c_int, ctypes.c_void_p]
stream = libc.fopen(sys.argv[2].encode(), b"w")
libc.malloc_info(0, stream)
libc.fclose(stream)
print(open(sys.argv[2]).read().count("<heap nr="))
"""


@pytest.mark.skipif("linux" not in sys.platform, reason="glibc's")
def test_threads_share_one_heap(tmp_path):
    heaps = {
        name: int(
            subprocess.run(
                [sys.executable, "-c", HEAPS, name, str(tmp_path / name)],
                check=True,
                capture_output=True,
                text=True,
            ).stdout
        )
        for name in ("compactly", "usually")
    }
    assert heaps["compactly"] == 1
    assert heaps["usually"] > 1
