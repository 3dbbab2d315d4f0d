"""What the search never saw, predicted with the law and without it.

Parameters come from the seen turns alone.  Each left-out turn counts with the left-out still at its beginning, in the sigmas of the noise
that the law's hypothesis has.  Turns are paired: Wilcoxon's signed ranks say how probable it is that chance improves as many.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from tinygc.closure.probability import chi_square_above
from tinygc.discovery.judge.answer import HeldOut
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.noise.session_noise import SessionNoise, first_noise
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.explanation.verdict.proof import LEAST_EXCESS, tilt_rms


class Unseen:
    """A whole recording, of which a search saw a part.  whole: its twin; seen: the twin that was searched."""

    def __init__(self, whole: Twin, seen: Twin):
        self.whole, self.white = whole, Whitener(whole)
        self._first = first_noise(whole, self.white)
        self._sensor_sigma = self.white.with_more(self._first.covariance).sigma
        in_seen = {(log, still.start) for log, still in seen.stills}
        self._left_out = np.array([(log, still.start) not in in_seen for log, still in whole.stills], dtype=bool)

    def sigma(self, noise: SessionNoise) -> np.ndarray:
        """(n,) of all rows, by noise that was estimated from a part of them."""
        s = np.array([noise.size(component.name) for component in self._first.components])
        return self.white.with_more(replace(self._first, s=s).covariance).sigma

    def judged(self, without: Hypothesis, law: Hypothesis, held: np.ndarray, recording: str | None = None) -> HeldOut | None:
        """How the law predicts the used segments ``held`` (indices); None where there are none."""
        if not len(held):
            return None
        sigma = self.sigma(law.noise)
        before, after = (self.whole.residuals(each.fit.state) for each in (without, law))
        gains = self._squares(before.stacked() / sigma)[held] - self._squares(after.stacked() / sigma)[held]
        p_value = float(stats.wilcoxon(gains, alternative="greater").pvalue) if np.any(gains) else 1.0
        floor = float(np.sqrt(np.mean(self._tilt_variance()[held])))
        rms = [tilt_rms(each.closure[held]) for each in (before, after)]
        excess = rms[0] ** 2 - floor**2
        removed = None if excess < LEAST_EXCESS * floor**2 else 1 - max(rms[1] ** 2 - floor**2, 0.0) / excess
        return HeldOut(rms[0], rms[1], floor, removed, p_value, self._noise_p(after.stacked(), held), len(held), recording)

    def _noise_p(self, after: np.ndarray, held: np.ndarray) -> float:
        """Of white noise and the bias instability of the sensor: nothing that the law leaves counts as noise because it is there."""
        closure = (after / self._sensor_sigma)[self.white.parts["closure"]].reshape(len(self.whole.segments), -1)[held]
        return chi_square_above(float(np.sum(closure**2)), closure.size)

    def _tilt_variance(self) -> np.ndarray:
        """(S,) rad^2 of both angles of tilt, by white noise alone."""
        white = self.whole.problem.floor.white
        return white[:, 0, 0] + white[:, 1, 1]

    def _squares(self, rows: np.ndarray) -> np.ndarray:
        """(S,) of rows (n,) in sigmas: of each segment, and of the still at its beginning where that was left out, too."""
        closure, still, length = (rows[part] ** 2 for part in self.white.parts.values())
        of_stills = (still.reshape(-1, 3).sum(axis=1) + length) * self._left_out
        return closure.reshape(len(self.whole.segments), -1).sum(axis=1) + of_stills[self.whole.first]
