"""Lines in the noise at rest of one sensor: of a table that vibrates, or of interference.

White noise and the sensor's own 1/f noise have none.  Frequencies count as they do in the noise that ``check`` states, which is from means
of 0.1 s.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.detect.stills import Still, block_size, references
from session.log.samples import Samples

#: s of a section of a still, tried in turn; and sections that are enough
SECTION_S = (4.0, 2.0, 1.0, 0.5)
ENOUGH, FEWEST = 32, 10
#: most sections that are looked at: their shares are then known to 0.2 %
MOST = 1000
#: level of each test: this much in a hundred sound logs, of lines over all frequencies and axes together
LEVEL = 0.01
#: bins of the background on either side of a line, and those next to it that hold its own power (Hann's window has 4 wide)
AROUND, NEXT = 12, 2


#: of one axis: frequencies, Hz, strongest first, and the share of the axis's noise power that they hold together
Lines = tuple[tuple[float, ...], float]


def rest_lines(samples: Samples, stills: Sequence[Still], accelerometer: bool) -> tuple[Lines, ...] | None:
    """Lines of each axis of the gyro, or of the accelerometer, in stills; None where they are too short, or an axis shows no noise."""
    rows = sections(samples, stills)
    if rows is None:
        return None
    signal = np.stack([np.asarray((samples.accel if accelerometer else samples.gyro)[a:b]) for a, b in rows])
    if not (np.ptp(signal, axis=1) > 0).any(axis=0).all():
        return None  # an axis that rests at one reading: its rounding hides the noise
    own = spectra(signal)
    hz = np.fft.rfftfreq(rows[0][1] - rows[0][0], samples.period_s)
    passed = np.sinc(hz * block_size(samples.period_s) * samples.period_s) ** 2
    return lines_of(own, hz, np.mean(np.abs(own) ** 2, axis=0) * passed[:, None])


def sections(samples: Samples, stills: Sequence[Still]) -> list[tuple[int, int]] | None:
    """Rows of sections of equal length within undisturbed stills; None where there are too few."""
    whole = [still for still in references(stills) if not still.bumps]
    for length_s in SECTION_S:
        size = round(length_s / samples.period_s)
        rows = [(at, at + size) for still in whole for at in range(still.start, still.stop - size + 1, size)] if size >= 16 else []
        if len(rows) >= (FEWEST if length_s == SECTION_S[-1] else ENOUGH):
            return rows[:: -(-len(rows) // MOST)]
    return None


def spectra(x: np.ndarray) -> np.ndarray:
    """(K, F, n) Fourier coefficients of sections (K, L, n) without their lines through the ends' means, in Hann's window."""
    length = x.shape[1]
    t = np.arange(length) - (length - 1) / 2
    x = x - x.mean(axis=1, keepdims=True)
    x = x - t[:, None] * np.einsum("l,kln->kn", t / (t @ t), x)[:, None]
    return np.asarray(np.fft.rfft(x * np.hanning(length + 1)[:-1, None], axis=1))


def lines_of(x: np.ndarray, hz: np.ndarray, weights: np.ndarray) -> tuple[Lines, ...]:
    """Lines of each axis of x (K, F, 3): peaks of the mean periodogram that chance makes of their surroundings in less than one log of a
    hundred.  weights (F, 3): power of each frequency in the stated noise."""
    from scipy.special import gammaincc, gammaincinv  # late: most recordings have no long rest

    count = len(x)
    density = np.mean(np.abs(x) ** 2, axis=0)
    middle = gammaincinv(count, 0.5) / count  # the median of a mean periodogram, of its mean
    found = []
    for axis, level in enumerate(density.T):
        tests, above = len(level) * density.shape[1], np.zeros(len(level))
        peaks = []
        for k in range(2, len(level) - 1):
            low, high = max(k - AROUND, 1), min(k + AROUND + 1, len(level) - 1)
            near = np.r_[low : max(k - NEXT, low), min(k + NEXT + 1, high) : high]
            if len(near) < AROUND or level[k] < level[max(k - NEXT, 0) : k + NEXT + 1].max():
                continue
            usual = float(np.median(level[near])) / middle
            if tests * gammaincc(count, count * level[k] / usual) < LEVEL:
                own = slice(max(k - NEXT, 1), k + NEXT + 1)
                above[own] = np.maximum(level[own] - usual, 0) / level[own]
                peaks.append((level[k], float(hz[k])))
        share = float(above @ weights[:, axis] / weights[1:, axis].sum())
        found.append((tuple(at for _, at in sorted(peaks, reverse=True)), share))
    return tuple(found)
