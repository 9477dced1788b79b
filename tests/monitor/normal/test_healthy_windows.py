"""The healthy windows of a calibration judge later ones of the same motion."""

from dataclasses import replace

import numpy as np
import pytest

from ema_monitor.normal.healthy_windows import HealthyWindows, figures_of

from .test_features import slide


@pytest.fixture(scope="module")
def healthy():
    return HealthyWindows.of(slide(noise=0.02, seed=seed) for seed in range(12))


def test_window_departs_where_its_figures_do(healthy):
    same = healthy.departure(0, figures_of(slide(noise=0.02, seed=20)))
    rough = healthy.departure(0, figures_of(slide(noise=0.04, seed=20)))
    assert (same.is_significant, rough.is_significant) == (False, True)
    assert any("current" in one.name and "roughness" in one.name for one in rough.changes)


def test_stretches_are_compared_with_means_of_as_many_healthy_windows():
    """A load that swings from window to window hides a change of one, not of the mean of three."""
    loads = 0.1 + 0.03 * np.tile([-1.0, 0.0, 1.0], 5)
    healthy = HealthyWindows.of(
        slide(load=load, noise=0.02, seed=seed) for seed, load in enumerate(loads)
    )
    changed = [
        part
        for seed, load in enumerate(loads[:3] + 0.03)
        for part in figures_of(slide(load=load, noise=0.02, seed=30 + seed))
    ]
    alone = [healthy.departure(0, [one]) for one in changed]
    assert [one and one.is_significant for one in alone] == [False] * 3
    found = healthy.departure(0, changed)
    assert found
    assert {one.name for one in found.changes} == {"current_forward", "current_backward"}


def test_other_motion_is_not_judged(healthy):
    window = slide(noise=0.02, seed=20)
    faster = replace(window, command=1.2 * window.command)
    for parts in (figures_of(faster), []):
        assert healthy.departure(0, parts) is None
    assert HealthyWindows.of([window] * 2).departure(0, figures_of(window)) is None


def test_file_holds_all_of_it(healthy):
    still = slide(noise=0.02)
    no_rest = replace(still, command=np.abs(np.arange(len(still)) % 100 - 49.5))
    both = HealthyWindows((*healthy.windows, (5, figures_of(no_rest)[0])))
    assert "rest_current" not in both.windows[-1][1].features
    assert HealthyWindows.of_mapping(both.as_mapping()) == both


def test_healthy_windows_of_several_loads_judge_each_load_by_its_own():
    """Without that, the loads would be the scatter, and a load would explain what departs."""
    loads = [0.1, 0.4] * 6
    healthy = HealthyWindows.of(
        slide(load=load, noise=0.02, seed=seed) for seed, load in enumerate(loads)
    )
    assert healthy.loads == pytest.approx((-0.15, 0.15), abs=0.02)
    for load in (0.1, 0.4, 0.8):
        same = healthy.departure(0, figures_of(slide(load=load, noise=0.02, seed=30)))
        dry = healthy.departure(0, figures_of(slide(load=load, friction=0.68, noise=0.02, seed=30)))
        assert same
        assert dry
        is_known = load < 0.5
        assert (same.is_significant, same.at_known_load) == (not is_known, is_known)
        assert (dry.is_significant, dry.at_known_load) == (True, is_known)
    # Of a load that one window alone had nothing is known.
    once = HealthyWindows((*healthy.windows, (0, figures_of(slide(load=0.8, noise=0.02))[0])))
    assert once.departure(0, figures_of(slide(load=0.8, noise=0.02, seed=30))) is None
