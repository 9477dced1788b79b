# SPDX-License-Identifier: Apache-2.0
"""The band of a residual that carries information."""

import numpy as np
import pytest

from ema_monitor.windows.band import BAND_S, band_limited, band_samples, rms

H = 1e-4
LENGTH = round(BAND_S / H)


def centres(n_band: int):
    """Return times at the middle of windows, which overlap by half."""
    return H * (LENGTH / 2 * np.arange(n_band) + (LENGTH - 1) / 2)


def test_there_is_a_value_every_half_window():
    assert band_samples(5000, H) == LENGTH // 2
    assert band_limited(np.zeros(5000), H).shape == (5000 * 2 // LENGTH - 1,)


def test_straight_line_is_unchanged():
    values = band_limited(3.0 - 40.0 * H * np.arange(300.0), H)
    assert values == pytest.approx(3.0 - 40.0 * centres(len(values)), rel=1e-12)


@pytest.mark.parametrize("frequency", [20.0, 500.0, 777.0, 1000.0, 3100.0])
def test_sine_is_attenuated_as_by_a_hann_window(frequency):
    """The transform of the window is three Dirichlet kernels, two of them half as large."""
    wave = np.sin(2 * np.pi * frequency * H * np.arange(5000) + 0.3)
    values = band_limited(wave, H)

    def dirichlet(x):
        # The offset avoids division by zero: its square is the error.
        return np.sin(LENGTH * (x + 1e-9) / 2) / (LENGTH * np.sin((x + 1e-9) / 2))

    x, beside = 2 * np.pi * frequency * H, 2 * np.pi / LENGTH
    share = dirichlet(x) + (dirichlet(x - beside) + dirichlet(x + beside)) / 2
    expected = share * np.sin(2 * np.pi * frequency * centres(len(values)) + 0.3)
    assert values == pytest.approx(expected, abs=1e-7)


def test_every_sample_has_the_same_weight_except_near_the_ends():
    n = 10 * LENGTH
    response = band_limited(np.eye(n), H)
    counts = np.sum(response, axis=1)[LENGTH // 2 : -LENGTH // 2]
    assert counts == pytest.approx(2 / LENGTH, rel=1e-12)
    assert np.all(response >= 0.0)


@pytest.mark.parametrize("left", [0, 1, LENGTH // 2 - 1])
def test_samples_that_fill_no_window_are_left_out(left):
    full = np.random.default_rng(0).normal(size=5 * LENGTH)
    assert np.array_equal(
        band_limited(np.append(full, np.full(left, 99.0)), H), band_limited(full, H)
    )


@pytest.mark.parametrize("n", [2, 3, 5, LENGTH - 1, LENGTH, LENGTH + 1, 2 * LENGTH + 3])
def test_short_row_has_at_least_one_value(n):
    values = band_limited(np.full(n, -2.0), H)
    assert len(values) >= 1
    assert values == pytest.approx(-2.0, rel=1e-12)


def test_rows_are_processed_independently():
    rows = np.random.default_rng(1).normal(size=(3, 4, 250))
    together = band_limited(rows, H)
    assert together.shape == (3, 4, 250 * 2 // LENGTH - 1)
    for i, j in np.ndindex(3, 4):
        # Rows are multiplied with the window in blocks: rounding.
        assert together[i, j] == pytest.approx(band_limited(rows[i, j], H), rel=1e-12, abs=1e-15)


def test_samples_as_long_as_the_band_are_unchanged():
    """At 1 kHz, neighbours are averaged; from 1.5 ms on, a sample is itself a mean over a band."""
    row = np.random.default_rng(0).normal(size=50)
    assert band_limited(row, 1e-3) == pytest.approx((row[:-1] + row[1:]) / 2, rel=1e-12)
    assert np.array_equal(band_limited(row, 2e-3), row)
    assert np.array_equal(band_limited(np.stack([row, -row]), 5e-3), np.stack([row, -row]))


def test_rms_of_a_whole_sine_is_its_amplitude_over_root_two():
    assert rms(3.0 * np.sin(2 * np.pi * np.arange(100) / 100)) == pytest.approx(3 / np.sqrt(2))
