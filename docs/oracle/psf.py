"""Point spread of two linear probes by PyMUST, printed as CSV.

PyMUST's `pfield` gives the spectrum of the pressure at points in front of the array: an aperture of
depth / F# focused at the depth of interest, elevation focusing and baffle as PyMUST's description of the probe
has them, no attenuation. With the same aperture on receive, the echo of a point has the spectrum

    E(f) = pulse(f) · probe(f)² · H(f)²,    pfield's spectrum being pulse(f) · probe(f) · H(f)

A width is the distance between the outermost points where the peak of the echo's envelope is half of its
maximum (−6 dB): along x, along y, and, for the point on the axis, along depth = c·t/2.

README.md says how to rebuild the result.
"""

from importlib.metadata import version

import numpy as np
import pymust

PROBES = ["L11-5v", "L12-3v"]
DEPTHS_MM = [8, 10, 12, 15, 18, 20, 25, 30, 35, 40, 45]
# Usual for dynamic receive focus; the same on transmit.
F_NUMBER = 2.0
SOUND_SPEED_M_S = 1540.0
# Half widths of the profiles, which are symmetric, and their steps, in mm.
LATERAL_MM = (0.6, 0.02)
ELEVATION_MM = (3.0, 0.04)
# Never exactly in the plane: `pfield` drops elevation focusing when every y is below a nanometre.
OUT_OF_PLANE_M = 1e-8


def echo_spectra(probe, depth_m, x_m, y_m):
    """Frequencies in Hz and E(f) for points at (x, y, depth), one row each."""
    param = pymust.getparam(probe)
    param.c = SOUND_SPEED_M_S
    count = min(round(depth_m / F_NUMBER / param.pitch), param.Nelements)
    param.Nelements = count
    element_x_m = (np.arange(count) - (count - 1) / 2) * param.pitch
    distance_m = np.hypot(element_x_m, depth_m)
    delays_s = ((distance_m.max() - distance_m) / SOUND_SPEED_M_S).reshape(1, -1)
    options = pymust.utils.Options()
    options.FullFrequencyDirectivity = True
    # `pfield` renews the elevational field every twentieth frequency only; a step this fine makes that harmless.
    options.FrequencyStep = 0.1
    z_m = np.full(x_m.shape, depth_m)
    _, pressure, used = pymust.pfield(x_m, y_m, z_m, delays_s, param, False, options)
    pressure = pressure.reshape(len(x_m), -1).astype(complex)
    f_hz = np.linspace(0, 2 * param.fc, len(used))
    omega = 2 * np.pi * f_hz[used]
    pulse = param.getPulseSpectrumFunction(None)(omega)
    spectra = np.zeros((len(x_m), len(f_hz)), complex)
    spectra[:, used] = pressure**2 / pulse
    return f_hz, spectra


def envelopes(f_hz, spectra, oversampling=8):
    """Time step in s, and the echoes' envelopes: the spectra hold positive frequencies only."""
    samples = oversampling * spectra.shape[1]
    step_s = 1 / (samples * f_hz[1])
    return step_s, np.abs(np.fft.ifft(spectra, samples, axis=1))


def width(profile, step):
    """Distance of the outermost crossings of half the maximum, linearly interpolated."""
    level = profile / profile.max() - 0.5
    above = np.flatnonzero(level >= 0)
    low, high = above[0], above[-1]
    if low == 0 or high == len(level) - 1:
        raise ValueError("the profile does not fall to half within its range")
    left = low - level[low] / (level[low] - level[low - 1])
    right = high + level[high] / (level[high] - level[high + 1])
    return (right - left) * step


def mirrored(half):
    return np.concatenate([half[:0:-1], half])


def lateral_mm(probe, depth_m):
    reach, step = LATERAL_MM
    x_m = np.arange(0, reach + step / 2, step) * 1e-3
    _, envelope = envelopes(*echo_spectra(probe, depth_m, x_m, np.full(x_m.shape, OUT_OF_PLANE_M)))
    return width(mirrored(envelope.max(axis=1)), step)


def elevation_mm(probe, depth_m):
    reach, step = ELEVATION_MM
    y_m = np.arange(0, reach + step / 2, step) * 1e-3 + OUT_OF_PLANE_M
    _, envelope = envelopes(*echo_spectra(probe, depth_m, np.zeros(y_m.shape), y_m))
    return width(mirrored(envelope.max(axis=1)), step)


def on_axis(probe, depth_m):
    """Of a point on the axis: axial width in mm, centre of the echo's spectrum in MHz, fractional bandwidth.

    The last two are the mean frequency under |E(f)| and 2.355 times its spread, over the mean: for a Gaussian
    spectrum the usual centre and −6 dB bandwidth. PyMUST's spectrum is flatter on top than a Gaussian near the
    elevation focus and notched far from it, so the −6 dB points would say less about the pulse's length.
    """
    # Two points, as one alone confuses `pfield`'s shapes.
    place = np.zeros(2)
    f_hz, spectra = echo_spectra(probe, depth_m, place, place + OUT_OF_PLANE_M)
    step_s, envelope = envelopes(f_hz, spectra[:1], oversampling=64)
    pulse = np.roll(envelope[0], len(envelope[0]) // 2 - np.argmax(envelope[0]))
    axial = width(pulse, step_s * SOUND_SPEED_M_S / 2 * 1e3)
    weight = np.abs(spectra[0]) / np.abs(spectra[0]).sum()
    centre_hz = (weight * f_hz).sum()
    spread_hz = np.sqrt((weight * (f_hz - centre_hz) ** 2).sum())
    return axial, centre_hz * 1e-6, 2 * np.sqrt(2 * np.log(2)) * spread_hz / centre_hz


def main():
    print("# Two-way -6 dB widths by PyMUST", version("pymust"), "at F#", F_NUMBER, "and", SOUND_SPEED_M_S, "m/s.")
    print("# Written by docs/oracle/psf.py; docs/oracle/README.md says how to rebuild it.")
    print("# centre_mhz and bandwidth: mean, and 2.355 times the relative spread, of the spectrum of an echo on the axis.")
    print("probe,depth_mm,axial_mm,lateral_mm,elevation_mm,centre_mhz,bandwidth")
    for probe in PROBES:
        for depth_mm in DEPTHS_MM:
            depth_m = depth_mm * 1e-3
            axial, centre_mhz, band = on_axis(probe, depth_m)
            lateral, elevation = lateral_mm(probe, depth_m), elevation_mm(probe, depth_m)
            row = [f"{axial:.4f}", f"{lateral:.3f}", f"{elevation:.3f}", f"{centre_mhz:.2f}", f"{band:.3f}"]
            print(",".join([probe, str(depth_mm), *row]), flush=True)


if __name__ == "__main__":
    main()
