"""The noise at rest of one sensor: lines, slope, and the share of it that gyro and accelerometer have in common.

White noise and the sensor's own 1/f noise have no lines, and differ between gyro and accelerometer.  A table that vibrates makes lines, or
moves both at once.  Frequencies count as they do in the noise that ``check`` states, which is from means of 0.1 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import erfc, sqrt
from statistics import NormalDist

import numpy as np

from session.base.texts import listed
from session.detect.stills import BLOCK_S, Still, block_size, references
from session.log.samples import Samples

#: s of a section of a still, tried in turn; and sections that are enough: a coherence of 0.2 shows, with three predictors
SECTION_S = (4.0, 2.0, 1.0, 0.5)
ENOUGH, FEWEST = 32, 10
#: most sections that are looked at: their shares are then known to 0.2 %
MOST = 1000
#: level of each test: this much in a hundred sound logs, of lines over all frequencies and axes together
LEVEL = 0.01
#: sigmas of a one-sided limit of 95 %
ONE_SIDED = NormalDist().inv_cdf(0.95)
#: bins of the background on either side of a line, and those next to it that hold its own power (Hann's window has 4 wide)
AROUND, NEXT = 12, 2
#: slope of the density, per octave of frequency in powers of f, above which noise is not called white: halfway to 1/f
WHITE_SLOPE = 0.5


@dataclass(frozen=True)
class Share:
    """A share of noise power, unbiased, with its sigma where it is zero, and the probability of as much by chance."""

    value: float
    sigma: float

    @property
    def p_value(self) -> float:
        """Of one as large by chance, one-sided."""
        return erfc(self.value / self.sigma / sqrt(2)) / 2

    @property
    def upper(self) -> float:
        """Upper 95 % limit."""
        return max(self.value, 0.0) + ONE_SIDED * self.sigma


#: of one axis: frequencies, Hz, strongest first, and the share of the axis's noise power that they hold together
Lines = tuple[tuple[float, ...], float]


@dataclass(frozen=True, eq=False)
class RestSpectrum:
    """Noise at rest of one sensor: lines of each axis; slope of log density over log frequency, and its sigma; axes: the share of each
    axis's noise that the other two follow; other: the share that the other sensor (gyro or accelerometer) follows."""

    lines: tuple[Lines, ...]
    slope: float
    slope_sigma: float
    axes: Share
    other: Share

    @property
    def follows(self) -> float:
        """Share of the power that the other sensor follows, 0 where it does not show."""
        return self.other.value if self.other.p_value < LEVEL else 0.0

    def words(self, other: str, axis: int) -> str:
        """Describe it: ``no line, white, follows the accelerometer in less than 2 % (95 %)``; other: the other sensor's name; axis: whose
        lines are described."""
        hz, share = self.lines[axis]
        named = listed([f"{x:.3g}" for x in hz], 3)
        found = [f"{len(hz)} line{'s' * (len(hz) != 1)} ({named} Hz) with {100 * share:.0f} % of {'xyz'[axis]}"]
        found = found if hz else ["no line"]
        if abs(self.slope) + ONE_SIDED * self.slope_sigma < WHITE_SLOPE:
            found.append("else white" if hz else "white")
        elif abs(self.slope) / self.slope_sigma > NormalDist().inv_cdf(1 - LEVEL / 2):
            found.append(f"its density goes as f^{self.slope:.1f}")
        found += [_follows(self.axes, "an axis follows the others"), _follows(self.other, f"it follows the {other}")]
        return ", ".join(found)


def _follows(share: Share, words: str) -> str:
    if share.p_value < LEVEL:
        return f"{words} in {100 * share.value:.0f} %"
    return f"{words} in less than {max(100 * share.upper, 1):.0f} % (95 %)"


def rest_spectrum(samples: Samples, stills: Sequence[Still], accelerometer: bool) -> RestSpectrum | None:
    """Return the noise of the gyro, or of the accelerometer, in stills; None where they are too short, or an axis shows none."""
    rows = sections(samples, stills)
    if rows is None:
        return None
    signals = [np.stack([np.asarray(values[a:b]) for a, b in rows]) for values in (samples.gyro, samples.accel)]
    if not all((np.ptp(x, axis=1) > 0).any(axis=0).all() for x in signals):
        return None  # an axis that rests at one reading: its rounding hides the noise
    own, other = (spectra(x) for x in (reversed(signals) if accelerometer else signals))
    hz = np.fft.rfftfreq(rows[0][1] - rows[0][0], samples.period_s)
    passed = np.sinc(hz * block_size(samples.period_s) * samples.period_s) ** 2
    weights = np.mean(np.abs(own) ** 2, axis=0) * passed[:, None]
    slope, sigma = density_slope(own, hz)
    among = [_coherent_share(own[:, :, [i]], np.delete(own, i, axis=2), weights[:, [i]]) for i in range(3)]
    together = Share(float(np.mean([s.value for s in among])), float(np.mean([s.sigma for s in among])))
    return RestSpectrum(lines_of(own, hz, weights), slope, sigma, together, _coherent_share(own, other, weights))


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


def _coherent_share(x: np.ndarray, y: np.ndarray, weights: np.ndarray) -> Share:
    """Share of the power of x (K, F, n) that is linear in y (K, F, p), with weights (F, n): mean of the multiple coherence.

    Of K sections without coherence, each frequency's is Beta(p, K - p) (Koopmans 1974, 8.4), of mean p/K, which is taken off.  Every other
    frequency is used: in Hann's window neighbours are not independent.
    """
    count, p = len(x), y.shape[2]
    at = np.arange(2, x.shape[1] - 1, 2)
    x, y, weights = x[:, at], y[:, at], weights[at] / weights[at].sum()
    across = np.einsum("kfp,kfn->fpn", y.conj(), x)
    square = np.einsum("kfp,kfq->fpq", y.conj(), y)
    explained = np.real(np.einsum("fpn,fpn->fn", across.conj(), np.linalg.solve(square, across)))
    coherence = explained / np.sum(np.abs(x) ** 2, axis=0)
    chance = p / count
    variance = p * (count - p) / (count**2 * (count + 1))
    return Share(float((np.sum(weights * coherence) - chance) / (1 - chance)), float(np.sqrt(variance * np.sum(weights**2)) / (1 - chance)))


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


def density_slope(x: np.ndarray, hz: np.ndarray) -> tuple[float, float]:
    """Slope of log density over log frequency below 5 Hz, the band of means of 0.1 s, and its sigma, over the axes of x (K, F, n)."""
    use = np.flatnonzero((np.arange(len(hz)) >= 2) & (hz < 0.5 / BLOCK_S))
    if len(use) < 3:
        return 0.0, np.inf
    power = np.log(np.mean(np.abs(x[:, use]) ** 2, axis=0)).mean(axis=1)
    at = np.log(hz[use]) - np.log(hz[use]).mean()
    # log of a mean of K exponentials has variance 1/K; the window's neighbours share, so that half of the frequencies count
    return float(at @ power / (at @ at)), float(np.sqrt(2 / (len(x) * x.shape[2] * (at @ at))))
