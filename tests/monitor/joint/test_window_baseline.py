# SPDX-License-Identifier: Apache-2.0
"""The healthy windows of a calibration judge later windows with the same motion."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from ema_core.telemetry import Telemetry
from ema_monitor.joint.departure import HEALTHY, NONE_OF_THESE
from ema_monitor.joint.window_baseline import WindowBaseline
from ema_monitor.joint.window_figures import figures_of
from ema_monitor.reason_texts import text_of

from .test_window_figures import slide


@pytest.fixture(scope="module")
def healthy():
    return WindowBaseline.of(slide(noise=0.02, seed=seed) for seed in range(12))


def test_window_departs_if_its_figures_do(healthy):
    same = healthy.departure(0, figures_of(slide(noise=0.02, seed=20)))
    rough = healthy.departure(0, figures_of(slide(noise=0.04, seed=20)))
    assert (same.is_significant, rough.is_significant) == (False, True)
    assert any("current" in change.name and "roughness" in change.name for change in rough.changes)


def test_stretches_are_compared_with_means_of_equally_many_healthy_windows():
    """A load that varies between windows hides a change in one window, but not in three."""
    loads = 0.1 + 0.03 * np.tile([-1.0, 0.0, 1.0], 5)
    healthy = WindowBaseline.of(
        slide(load=load, noise=0.02, seed=seed) for seed, load in enumerate(loads)
    )
    changed = [
        part
        for seed, load in enumerate(loads[:3] + 0.045)
        for part in figures_of(slide(load=load, noise=0.02, seed=30 + seed))
    ]
    alone = [healthy.departure(0, [item]) for item in changed]
    assert [item and item.is_significant for item in alone] == [False] * 3
    departure = healthy.departure(0, changed)
    assert departure
    assert {item.name for item in departure.changes} == {"current_forward", "current_backward"}


def test_other_motion_is_not_judged(healthy):
    window = slide(noise=0.02, seed=20)
    faster = replace(window, command=1.2 * window.command)
    for parts in (figures_of(faster), []):
        assert healthy.departure(0, parts) is None
    # Each of several motions is judged by its own healthy windows.
    scales = (1.0, 1.3, 1.6)
    several = WindowBaseline.of(
        replace(window_of_seed, command=scale * window_of_seed.command)
        for scale in scales
        for window_of_seed in (slide(noise=0.02, seed=seed) for seed in range(4))
    )
    for friction, departs in ((0.6, False), (0.68, True)):
        dry = slide(friction=friction, noise=0.02, seed=22)
        parts = figures_of(window) + figures_of(replace(dry, command=1.3 * dry.command))
        departure = several.departure(0, parts)
        assert departure
        assert departure.is_significant == departs
    assert WindowBaseline.of([window] * 2).departure(0, figures_of(window)) is None


def test_file_stores_all_windows(healthy):
    both = labelled(healthy, "jammed", slide(noise=0.02, seed=20))
    del both.windows[-1].figures.values["rest_current"]
    assert WindowBaseline.of_mapping(both.as_mapping()) == both


def test_healthy_windows_of_several_loads_judge_each_load_separately():
    """Otherwise the loads would count as scatter, and a load would explain a departure."""
    loads = [0.1, 0.4] * 6
    healthy = WindowBaseline.of(
        slide(load=load, noise=0.02, seed=seed) for seed, load in enumerate(loads)
    )
    for load in (0.1, 0.4, 0.8):
        same = healthy.departure(0, figures_of(slide(load=load, noise=0.02, seed=30)))
        dry = healthy.departure(0, figures_of(slide(load=load, friction=0.68, noise=0.02, seed=30)))
        assert same
        assert dry
        is_known = load < 0.5
        assert (same.is_significant, same.load_explains) == (not is_known, not is_known)
        assert (dry.is_significant, dry.load_explains) == (True, not is_known)
    # A load with only one window cannot be judged.
    once = WindowBaseline(
        (*healthy.windows, *WindowBaseline.of([slide(load=0.8, noise=0.02)]).windows)
    )
    assert once.departure(0, figures_of(slide(load=0.8, noise=0.02, seed=30))) is None


def test_small_load_explains_only_levels(healthy):
    for noise, explains in ((0.02, True), (0.06, False)):
        departure = healthy.departure(0, figures_of(slide(load=0.15, noise=noise, seed=30)))
        assert departure
        assert (departure.is_significant, departure.load_explains) == (True, explains)


def test_parts_of_a_test_are_judged_by_their_own_loads():
    windows = [slide(load=load, noise=0.02, seed=n) for n, load in enumerate([0.1, 0.4] * 6)]
    baseline = WindowBaseline.of(windows)
    for friction, departs in ((0.6, False), (0.68, True)):
        some = [slide(load=0.1, noise=0.02, seed=30), slide(load=0.1, noise=0.02, seed=31)]
        some.append(slide(load=0.4, friction=friction, noise=0.02, seed=32))
        departure = baseline.departure(
            0, [part for slide_part in some for part in figures_of(slide_part)]
        )
        assert departure
        assert departure.is_significant == departs


def test_departure_that_may_be_due_to_the_day_is_stated(healthy):
    dry = figures_of(slide(friction=0.63, noise=0.02, seed=30))
    same, next_day = (healthy.departure(day * 86_400 * 10**9, dry) for day in (0, 1))
    assert same
    assert next_day
    assert (same.is_significant, same.would_depart) == (True, None)
    assert not next_day.is_significant
    assert next_day.would_depart
    words = "current in the forward stroke differs by +4 %; on a day without healthy tests, changes"
    assert words in text_of(next_day.would_depart)


def later(stamp_ns: int, *, state: str = "", **changes):
    """Return a slide at another time, with friction and roughness of its state."""
    changed = {"dry 1": {"friction": 0.66}, "dry 2": {"friction": 0.72}, "": {}}[state] | changes
    return replace(slide(noise=0.02, seed=stamp_ns, **changed), stamp_ns=stamp_ns)


def labelled(normal: WindowBaseline, state: str, telemetry: Telemetry) -> WindowBaseline:
    return normal.with_test(state, telemetry.stamp_ns, figures_of(telemetry))


def states_of(normal: WindowBaseline, telemetry: Telemetry) -> Mapping[str, float]:
    departure = normal.departure(telemetry.stamp_ns, figures_of(telemetry))
    assert departure
    return departure.states


def test_departure_resembles_a_labelled_state(healthy):
    baseline = healthy
    assert states_of(baseline, later(50, state="dry 1")) == {}
    for number in range(1, 4):
        baseline = labelled(baseline, "dry 1", later(number, state="dry 1"))
        baseline = labelled(baseline, "dry 2", later(10 + number, state="dry 2"))
    assert baseline.states() == {"healthy": 12, "dry 1": 3, "dry 2": 3}
    for state in ("dry 1", "dry 2"):
        assert next(iter(states_of(baseline, later(50, state=state)))) == state
        departure = baseline.departure(50, figures_of(later(50, state=state)))
        assert departure
        assert departure.likeness
        assert f"the most probable labelled state is {state} (" in text_of(departure.likeness)
    assert next(iter(states_of(baseline, later(50, friction=1.5)))) == NONE_OF_THESE
    assert next(iter(states_of(baseline, later(50)))) == HEALTHY
    faster = later(50, state="dry 1")
    for strange, words in (
        (later(50, load=0.3), "no state is named: the load is new, 0.2 A from"),
        (
            replace(faster, command=2.0 * faster.command),
            "no healthy window has the motion 6 rad at 2 rad/s, 25 Hz",
        ),
    ):
        departure = baseline.departure(50, figures_of(strange))
        assert departure
        assert departure.likeness
        assert (departure.states, words in text_of(departure.likeness)) == ({}, True)
    assert list(baseline.without("dry 1").states()) == [HEALTHY, "dry 2"]
    assert healthy.with_labels_of(baseline) == baseline
    # A figure of the labelled tests may be missing.
    lacking = figures_of(later(50, state="dry 1"))
    del lacking[0].values["rest_current"]
    departure = baseline.departure(50, lacking)
    assert departure
    assert "dry 1" in departure.states
    # Labelled again, and with another load, no state has three tests.
    anew = labelled(baseline, "dry 2", later(3, state="dry 1"))
    assert anew.states() == {"healthy": 12, "dry 1": 2, "dry 2": 4}
    with_loads = WindowBaseline(
        (*baseline.windows, *WindowBaseline.of(later(80 + n, load=0.5) for n in range(6)).windows)
    )
    assert states_of(with_loads, later(90, state="dry 1", load=0.5)) == {}
    assert "dry 1" in states_of(with_loads, later(90, state="dry 1"))


@pytest.mark.parametrize(
    ("times", "load", "message"),
    [
        (0.0, 0.0, "it has no strokes in both directions"),
        (1.2, 0.0, "no healthy window has its motion"),
        (1.0, 0.5, "its load differs by 0.4 A from the healthy windows"),
    ],
)
def test_test_that_cannot_be_compared_with_later_ones_is_not_labelled(
    healthy, times, load, message
):
    window = slide(noise=0.02, load=load)
    with pytest.raises(ValueError, match=message):
        labelled(healthy, "dry", replace(window, command=times * window.command))


def test_windows_that_are_alike_by_chance_judge_nothing():
    windows = [slide(noise=0.02, seed=seed) for seed in range(12)]
    varied = [
        replace(window, command=1.2 ** max(0, number - 3) * window.command)
        for number, window in enumerate(windows)
    ]
    assert WindowBaseline.of(varied).departure(0, figures_of(slide(noise=0.06, seed=90))) is None
