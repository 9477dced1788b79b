"""What the campaign concludes from courses of memory, and from counts of wrong windows."""

import importlib
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

CAMPAIGN = Path(__file__).parents[2] / "campaign"


@pytest.fixture(scope="module")
def soak() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(CAMPAIGN))
        return importlib.import_module("soak")


@pytest.fixture(scope="module")
def confidence() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(CAMPAIGN))
        return importlib.import_module("wrong_and_confident")


def samples(soak: ModuleType, memory: np.ndarray, minutes: np.ndarray, **more: int) -> list:
    return [
        soak.Sample(float(minute), float(value), more.get("threads", 9), 20)
        for minute, value in zip(minutes, memory, strict=True)
    ]


def test_slope_is_found_with_its_uncertainty_among_dependent_residuals(soak: ModuleType):
    minutes = np.arange(0.0, 110.0, 1.0 / 12.0)
    found, said = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        wander = np.zeros(len(minutes))
        for i in range(1, len(minutes)):
            wander[i] = 0.9 * wander[i - 1] + 0.1 * rng.standard_normal()
        slope, sigma = soak.line(minutes, 200.0 + 0.05 * minutes + wander)
        found.append(slope)
        said.append(sigma)
    # The mean of 40: 5 standard deviations of it. Their scatter is known to a tenth.
    assert np.mean(found) == pytest.approx(0.05, abs=5.0 * np.std(found) / np.sqrt(40.0))
    assert np.mean(said) == pytest.approx(np.std(found), rel=0.35)


def test_growth_after_settling_alone_counts(soak: ModuleType):
    minutes = np.arange(0.0, 60.0, 0.1)
    memory = 300.0 - 100.0 * np.exp(-minutes)
    assert soak.growth_of(samples(soak, memory, minutes), 10.0).is_steady
    leaking = soak.growth_of(samples(soak, memory + 0.2 * minutes, minutes), 10.0)
    assert not leaking.is_steady
    assert leaking.slope == pytest.approx(0.2, abs=1e-3)


def test_slope_that_is_not_known_well_enough_is_no_success(soak: ModuleType, tmp_path: Path):
    part = importlib.import_module("part")
    minutes = np.arange(0.0, 6.0, 0.1)
    memory = 100.0 + np.random.default_rng(1).standard_normal(len(minutes))
    case = part.Case(1, 0, tmp_path)
    soak._judge(case, {"monitor": samples(soak, memory, minutes)}, [0], 6.0)
    [failure] = case.failures
    assert failure.startswith("monitor cannot be judged: ")
    assert failure.endswith(": run longer")
    assert not soak.growth_of(samples(soak, memory, minutes), 2.0).is_steady


def test_process_that_died_is_named(soak: ModuleType):
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        # Ended, and not waited for; then gone.
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        with pytest.raises(soak.GraphError, match=r"^recorder died after 7\.0 min$"):
            soak.sample_of("recorder", process.pid, 7.0)
        assert soak.shared_bytes([process.pid]) == 0
    with pytest.raises(soak.GraphError, match=r"^recorder died after 7\.0 min$"):
        soak.sample_of("recorder", process.pid, 7.0)
    assert soak.shared_bytes([process.pid]) == 0


def test_thread_that_stays_is_growth(soak: ModuleType):
    minutes = np.arange(0.0, 60.0, 0.1)
    course = samples(soak, np.full(len(minutes), 100.0), minutes)
    later = [soak.Sample(one.minute, 100.0, 10, 20) for one in course[-50:]]
    assert soak.growth_of(course, 10.0).is_steady
    assert not soak.growth_of(course[:-50] + later, 10.0).is_steady


def test_process_that_is_sampled_is_this_one(soak: ModuleType):
    own = soak.sample(os.getpid(), 1.0)
    assert own.memory_mb > 5.0
    assert own.threads >= 1
    assert own.descriptors >= 3


def test_few_wrong_windows_are_chance_and_many_are_not(confidence: ModuleType):
    # Of 1,000 windows one in a thousand is wrong with probability 1 - 0.999^1000 = 0.632 once.
    assert confidence.chance(1, 1000, 1e-3) == pytest.approx(0.632, abs=1e-3)
    counts = {"windows, cold": 1000, "wrong and confident, cold": 3}
    assert confidence.judge(counts) == []
    counts["wrong and confident, cold"] = 6
    [line] = confidence.judge(counts)
    assert line.startswith("6 of 1000 windows are wrong and confident")


def test_cases_of_the_campaign_have_other_windows(confidence: ModuleType):
    first, later = confidence.conditions(0, 1), confidence.conditions(confidence.UNITS, 1)
    assert first.keys() == later.keys()
    assert all(tasks for tasks in first.values())
    same = [name for name in first if first[name][0] == later[name][0]]
    assert same == []
    kinds = {task.unit.kind for tasks in first.values() for task in tasks}
    assert "held out" not in kinds
