# SPDX-License-Identifier: Apache-2.0
"""Concurrent runs of the tests on one machine use different domains, which are locked."""

import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

from ema_core.domains import Domain

OTHER = """
import sys
from ema_core.domains import Domain
print(*(Domain().number for _ in range(30)), flush=True)
sys.stdin.read()
"""


def test_domains_in_all_processes_are_distinct():
    command = [sys.executable, "-c", OTHER]
    root = Path(__file__).parents[2]
    processes = [
        subprocess.Popen(
            command, cwd=root, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    taken = [int(os.environ["ROS_DOMAIN_ID"])]
    for process in processes:
        assert process.stdout is not None
        taken += [int(number) for number in process.stdout.readline().split()]
    domains = [Domain() for _ in range(5)]
    taken += [item.number for item in domains]
    assert len(taken) == len(set(taken)) == 66
    assert min(taken) >= 1
    assert max(taken) <= 101
    for item in domains:
        item.close()
    for process in processes:
        process.communicate()


def test_domain_stays_locked_by_a_process_that_outlives_its_parent():
    with closing(Domain()) as domain:
        orphan = subprocess.Popen(
            [sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=[domain.descriptor]
        )
    numbers = set()
    for _ in range(101):
        with closing(Domain()) as another:
            numbers.add(another.number)
    orphan.communicate(b"\n")
    assert domain.number not in numbers
