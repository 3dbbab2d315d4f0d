"""What an alarm is likely to be: a step or a ramp of one channel, when it began, and its size with its sigma.

The filter follows a change, so that its innovations show only what it has not followed yet: a change u(t) of the reading gives the mean
innovation g, by the same gains.  For each moment and form, the size is sum(z g) / sum(g^2) in sigmas, the log likelihood ratio half of
sum(z g)^2 / sum(g^2).  The likeliest ones are named; the size is the mean over all moments, and over both forms where they are not told
apart, by their probabilities, and its sigma contains how they differ.

A moment lies anywhere within a window: a step then moves that window's mean by a part of its size, which from one window on alone would
look like a ramp.  g is linear between a change at a window and one at the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tinygc.features.unit.watch.detector import STATES, Judged, Window
from tinygc.features.unit.watch.expectation import Settings

#: log likelihood ratio by which one form must be better than the other: odds of twenty to one
TOLD_APART = 3.0
#: sigma of the prior of a size, in the likeliest one's: moments just before the end, which tell no size, then have little of the mean
WIDE = 3.0
#: places within a window, of the whole and about the likeliest one in its sigmas
PLACES, SIGMAS = np.linspace(0, 1, 9), np.linspace(-4, 4, 9)
#: windows before the test's own beginning among which the change is looked for, and moments that are tried
BEFORE, TRIED = 30, 60


class Reading(NamedTuple):
    """t_s of a window, it, and what it gave, of whose copies the first counts."""

    t_s: float
    window: Window
    judged: Judged


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


def change_of(records: Sequence[Reading], channel: int, begun: int, chosen: Settings) -> Change:
    """The likeliest change of a channel (``settings.CHANNELS``), by a test whose sum began ``begun`` windows before the last record."""
    rows = list(records)
    count = len(rows)
    first = max(0, count - 1 - begun - BEFORE)
    moments = np.unique(np.linspace(first, count - 1, TRIED).round().astype(int))
    t_s = np.array([each.t_s for each in rows])
    forms = [_within_windows(rows, moments, ramp, channel, chosen) for ramp in (False, True)]
    gains = [score**2 / information / 2 for score, information, *_ in forms]
    better = float(gains[0].max() - gains[1].max())
    kind = "step" if better > TOLD_APART else "ramp" if better < -TOLD_APART else "step or ramp"
    likelier = int(better < 0)
    at = np.unravel_index(np.argmax(gains[likelier]), gains[likelier].shape)
    taken = forms if kind == "step or ramp" else [forms[likelier]]
    score, information, share, _ = (np.concatenate([each.ravel() for each in of]) for of in zip(*taken, strict=True))
    best = abs(forms[likelier][0][at] / forms[likelier][1][at])
    precision = information + 1 / max(WIDE * best, 1e-12) ** 2
    sizes = score / precision
    weight = share * np.exp(score * sizes / 2 - max(each.max() for each in gains)) / np.sqrt(precision)
    weight /= weight.sum()
    size = float(weight @ sizes)
    moment = int(moments[at[0]])
    began = t_s[moment - 1] + forms[likelier][3][at] * (t_s[moment] - t_s[moment - 1]) if moment > 0 else t_s[0]
    return Change(kind, float(began), moment == 0 and count > 1, size, float(np.sqrt(weight @ (1 / precision + (sizes - size) ** 2))))


def _within_windows(
    rows: Sequence[Reading], moments: np.ndarray, ramp: bool, channel: int, chosen: Settings
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of a change in each window of the moments, at K places within it: score and information of its size now, the prior share of the
    place, and the place, 0 to 1; each (M, K)."""
    z, t_s = np.array([each.judged.whole[channel, 0] for each in rows]), np.array([each.t_s for each in rows])
    ends = [np.minimum(moments + later, len(rows) - 1) for later in (0, 1)]
    own, after = (_response(rows, moments + later, ramp, channel, chosen) for later in (0, 1))
    A, B, C, a, b = (np.sum(own**2, axis=0), np.sum(own * after, axis=0), np.sum(after**2, axis=0), own.T @ z, after.T @ z)
    # The likeliest place, and its sigma, are those of least squares by both columns.
    parts = np.stack([C * a - B * b, A * b - B * a])
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.clip(np.nan_to_num(parts[1] / parts.sum(axis=0)), 0, 1)
        width = np.sqrt(np.maximum((best**2 * C + 2 * best * (1 - best) * B + (1 - best) ** 2 * A) * (A * C - B**2), 0.0))
        width = np.nan_to_num(width / np.abs(parts.sum(axis=0)), posinf=1.0)
    about = np.clip(best[:, None] + width[:, None] * SIGMAS, 0, 1)
    f = np.sort(np.concatenate([about, np.broadcast_to(PLACES, (len(moments), len(PLACES)))], axis=1), axis=1)
    gaps = np.diff(f, axis=1, prepend=0.0, append=1.0)
    e, A, B, C, a, b = (1 - f, *(each[:, None] for each in (A, B, C, a, b)))
    # What a size now, not a slope, would add.
    grown = np.maximum(t_s[-1] - e * t_s[ends[0]][:, None] - f * t_s[ends[1]][:, None], 1e-9) if ramp else 1.0
    information = np.maximum((e**2 * A + 2 * e * f * B + f**2 * C) / grown**2, 1e-12)
    return (e * a + f * b) / grown, information, (gaps[:, 1:] + gaps[:, :-1]) / 2, f


def _response(rows: Sequence[Reading], moments: np.ndarray, ramp: bool, channel: int, chosen: Settings) -> np.ndarray:
    """(N, M) mean innovation, in sigmas, of a unit step at each moment, or of a ramp of a unit a second from there on.

    Of gravity, whose filter depends on the attitude, the innovation is taken as the change itself.
    """
    index = np.arange(len(rows))
    t_s = np.array([each.t_s for each in rows])
    after = index[:, None] >= moments[None]
    change = np.where(after, t_s[:, None] - t_s[np.minimum(moments, len(rows) - 1)][None] if ramp else 1.0, 0.0)
    if channel == 3:
        return change / np.array([each.judged.sigma[1, 0] for each in rows])[:, None]
    decay = np.ones(STATES)
    decay[1 : 1 + len(chosen.decay)] = chosen.decay
    x, found = np.zeros((STATES, len(moments))), np.empty(change.shape)
    for number, (_, window, judged) in enumerate(rows):
        h = np.ones(STATES)
        h[-1] = window.warmer[0]
        innovation = change[number] - h @ x
        found[number] = innovation / judged.sigma[0, 0]
        if judged.taken[0]:
            x = x + judged.gain[:, :1] * innovation
        x = x * decay[:, None]
    return found
