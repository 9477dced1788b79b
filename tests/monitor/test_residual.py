"""The band of a residual that carries information."""

import numpy as np
import pytest

from ema_monitor.residual import BAND_S, band_limited, rms

H = 1e-4


def test_constant_passes_to_the_very_ends():
    assert band_limited(np.full(300, 0.7), H) == pytest.approx(0.7, rel=1e-12)


def test_impulse_becomes_the_hann_window():
    impulse = np.zeros(201)
    impulse[100] = 1.0
    n = round(BAND_S / H)
    # Weights sin^2 at the n inner points of n + 1 intervals; their sum is (n + 1) / 2.
    hann = np.sin(np.pi * np.arange(1, n + 1) / (n + 1)) ** 2 / ((n + 1) / 2)
    response = band_limited(impulse, H)
    [where] = np.nonzero(response)
    assert response[where] == pytest.approx(hann, rel=1e-12)
    # An even window has no middle: half a sample of shift is all there may be.
    assert abs(np.mean(where) - 100) <= 0.5


@pytest.mark.parametrize(("frequency", "share"), [(50.0, 1.0), (2000.0, 0.0)])
def test_slow_passes_and_ripple_does_not(frequency, share):
    t = H * np.arange(5000)
    wave = np.sin(2 * np.pi * frequency * t)
    # Away from the ends; 2 % is the window's droop at 50 Hz and its side lobe at 2 kHz.
    passed = rms(band_limited(wave, H)[50:-50]) / rms(wave)
    assert passed == pytest.approx(share, abs=0.02)


def test_a_period_longer_than_the_band_leaves_all():
    row = np.random.default_rng(0).normal(size=50)
    assert band_limited(row, 4e-3) == pytest.approx(row, rel=1e-12)


def test_rms_of_a_whole_sine_is_its_amplitude_over_root_two():
    assert rms(3.0 * np.sin(2 * np.pi * np.arange(100) / 100)) == pytest.approx(3 / np.sqrt(2))
