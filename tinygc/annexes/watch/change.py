"""What an alarm is likely to be: a step or a ramp of one channel, when it began, and its size with its sigma.

The filter follows a change, so that its innovations show only what it has not followed yet: a change u(t) of the reading gives the mean
innovation g, by the same gains.  For each moment and form, the size is sum(z g) / sum(g^2) in sigmas, the log likelihood ratio half of
sum(z g)^2 / sum(g^2).  The likeliest ones are named; the size is the mean over all moments, and over both forms where they are not told
apart, by their probabilities, and its sigma contains how they differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.annexes.watch.detector import STATES, Judged, Window
from tinygc.annexes.watch.settings import Settings

#: log likelihood ratio by which one form must be better than the other: odds of twenty to one
TOLD_APART = 3.0
#: sigma of the prior of a size, in the likeliest one's: moments just before the end, which tell no size, then have little of the mean
WIDE = 3.0
#: windows before the test's own beginning among which the change is looked for, and moments that are tried
BEFORE, TRIED = 30, 60


@dataclass(frozen=True, eq=False)
class WindowRecord:
    """t_s; z (4,), not clipped, sigma (2,), gain (5,), of the axes; warmer K; taken: whether the filter followed."""

    t_s: float
    z: np.ndarray
    sigma: np.ndarray
    gain: np.ndarray
    warmer: float
    taken: bool

    @classmethod
    def of(cls, t_s: float, window: Window, judged: Judged) -> WindowRecord:
        """Of the first of the copies."""
        return cls(t_s, judged.whole[:, 0], judged.sigma[:, 0], judged.gain[:, 0], float(window.warmer[0]), bool(judged.taken[0]))


@dataclass(frozen=True)
class Change:
    """kind: ``step``, ``ramp`` or ``step or ramp``; began_s: of the likeliest moment; earlier: whether it may have begun before what is
    remembered; size now, and its sigma, over all moments, normalised."""

    kind: str
    began_s: float
    earlier: bool
    size: float
    sigma: float

    def words(self, amount: str) -> str:
        """In words: ``step of +0.12 ± 0.01 dps at 120 s``."""
        moment = f"{self.began_s:.0f} s{' or earlier' if self.earlier else ''}"
        if self.kind == "step":
            return f"a step of {amount} at {moment}"
        if self.kind == "ramp":
            return f"a drift since {moment}, by {amount} so far"
        return f"a change of {amount} since {moment}, a step or a drift"


def change_of(records: Sequence[WindowRecord], channel: int, begun: int, chosen: Settings) -> Change:
    """The likeliest change of a channel (``settings.CHANNELS``), by a test whose sum began ``begun`` windows before the last record."""
    rows = list(records)
    count = len(rows)
    first = max(0, count - 1 - begun - BEFORE)
    moments = np.unique(np.linspace(first, count - 1, TRIED).round().astype(int))
    t_s = np.array([row.t_s for row in rows])
    z = np.array([row.z[channel] for row in rows])
    forms = []
    for ramp in (False, True):
        mean = _response(rows, moments, ramp, channel, chosen)
        # What a size now, not a slope, would add.
        mean = mean / np.maximum(t_s[-1] - t_s[moments], 1e-9) if ramp else mean
        forms.append((mean.T @ z, np.maximum(np.sum(mean**2, axis=0), 1e-12)))
    gains = np.array([score**2 / information / 2 for score, information in forms])
    better = float(gains[0].max() - gains[1].max())
    kind = "step" if better > TOLD_APART else "ramp" if better < -TOLD_APART else "step or ramp"
    likelier = int(better < 0)
    at = int(np.argmax(gains[likelier]))
    score, information = (np.concatenate(each) for each in zip(*(forms if kind == "step or ramp" else [forms[likelier]]), strict=True))
    best = abs(forms[likelier][0][at] / forms[likelier][1][at])
    precision = information + 1 / max(WIDE * best, 1e-12) ** 2
    sizes = score / precision
    weight = np.exp(score * sizes / 2 - gains.max()) / np.sqrt(precision)
    weight /= weight.sum()
    size = float(weight @ sizes)
    moment = int(moments[at])
    began = t_s[moment - 1] if moment > 0 else t_s[0]
    return Change(kind, float(began), moment == 0 and count > 1, size, float(np.sqrt(weight @ (1 / precision + (sizes - size) ** 2))))


def _response(rows: Sequence[WindowRecord], moments: np.ndarray, ramp: bool, channel: int, chosen: Settings) -> np.ndarray:
    """(N, M) mean innovation, in sigmas, of a unit step at each moment, or of a ramp of a unit a second from there on.

    Of gravity, whose filter depends on the attitude, the innovation is taken as the change itself.
    """
    index = np.arange(len(rows))
    t_s = np.array([row.t_s for row in rows])
    after = index[:, None] >= moments[None]
    change = np.where(after, t_s[:, None] - t_s[moments][None] if ramp else 1.0, 0.0)
    if channel == 3:
        return change / np.array([row.sigma[1] for row in rows])[:, None]
    decay = np.ones(STATES)
    decay[1 : 1 + len(chosen.decay)] = chosen.decay
    x, found = np.zeros((STATES, len(moments))), np.empty(change.shape)
    for number, row in enumerate(rows):
        h = np.ones(STATES)
        h[-1] = row.warmer
        innovation = change[number] - h @ x
        found[number] = innovation / row.sigma[0]
        if row.taken:
            x = x + row.gain[:, None] * innovation
        x = x * decay[:, None]
    return found
