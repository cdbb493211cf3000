#!/bin/sh
# spectrum 0.10.0: `Periodogram` is not divided by the sampling rate, nor by the power of its window, nor doubled for
# one side, where `pburg` and `WelchPeriodogram` of the same package are one-sided densities in the square of the unit
# per Hz. `scale_by_freq` multiplies by 2 pi over the step of frequency, in `Periodogram` twice, and in `pyule` by
# default; the documentation says that it divides. `speriodogram` takes the mean off after the window, which leaves
# most of it in, and `detrend="mean"` of `Periodogram` does nothing; the documentation says of both that the mean is
# removed from the data, and calls all of them estimates of the power spectral density.
# Seen for white noise of 0.1 rad/s at 100 and 1000 Hz, with a density of 2.0e-4 and 2.0e-5: `pburg` 2.0e-4 and 2.0e-5,
# `Periodogram` 3.8e-3 at both, with scale_by_freq 253 and 2.53, and `pyule` 5.2e-2 and 5.2e-4. With a constant of 9.81
# the second line of `speriodogram` is 2.1e+4; with the mean taken off before it is 0.002.
# It matters where a gyro's noise or the power of gusts is read from such a spectrum: the noise density, its root, is 4
# times too large at 100 Hz and 14 times at 1000 Hz, and an accelerometer's gravity covers its slow motion.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q spectrum==0.10.0 numpy==2.1.3 scipy==1.14.1 matplotlib==3.9.2
cd "$folder"
export MPLCONFIGDIR="$folder" MPLBACKEND=Agg
"$folder/venv/bin/python" -W ignore - <<'PY'
import numpy as np
import spectrum

NOISE, COUNT = 0.1, 4096
gyro = NOISE * np.random.default_rng(0).normal(size=COUNT)
gyro *= NOISE / gyro.std()


def density(kind, rate, *order, **options):
    """Return the mean over all frequencies of a spectrum."""
    found = kind(gyro, *order, sampling=rate, **options)
    found.run()
    return float(np.mean(found.psd))


for rate in (100.0, 1000.0):
    right = 2.0 * NOISE**2 / rate
    burg, yule = density(spectrum.pburg, rate, 4), density(spectrum.pyule, rate, 4)
    step_scale = 2.0 * np.pi * COUNT / rate
    welch = float(np.mean(spectrum.WelchPeriodogram(gyro, NFFT=256, sampling=rate)[0][0]))
    plain = density(spectrum.Periodogram, rate)
    scaled = density(spectrum.Periodogram, rate, scale_by_freq=True)
    print(f"{rate:.0f} Hz: right {right:.2e}, pburg {burg:.2e}, pyule {yule:.2e}, Welch {welch:.2e},", end=" ")
    print(f"Periodogram {plain:.2e}, scaled {scaled:.2e}")
    assert np.allclose([burg, welch], right, rtol=0.1)
    assert np.isclose(plain, 0.375 * NOISE**2, rtol=0.05)
    assert np.isclose(scaled, plain * step_scale**2, rtol=0.05)
    assert np.isclose(yule, right * step_scale, rtol=0.1)

gravity = 9.81 + gyro
taken_off = spectrum.speriodogram(gravity, scale_by_freq=False)
before = spectrum.speriodogram(gravity - gravity.mean(), scale_by_freq=False)
kept = spectrum.Periodogram(gravity, sampling=100.0, detrend="mean")
kept.run()
whole = spectrum.Periodogram(gravity, sampling=100.0)
whole.run()
print("first two lines with the mean in it:", taken_off[:2].round(3).tolist())
print("with the mean taken off before:     ", before[:2].round(3).tolist())
assert np.all(taken_off[:2] > 1e4) and np.all(before[:2] < 1.0)
assert np.allclose(kept.psd, whole.psd)
PY
