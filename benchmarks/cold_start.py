"""What a session that begins cold costs: coached sessions of a board that warms up, begun at once and after ten minutes.

A hand at a simulated table follows the coach, its seconds too, until every number is good enough.  The board warms up exponentially by
``--warm`` degrees, and each axis' bias follows by so many mdps per degree, drawn with a data sheet's typical value as sigma.  Errors are
those of least squares against the truth, of B against its mean over the turns, in units of the coach's targets and of the sigmas that
`fit` states.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from common import in_parallel, markdown
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from coached_hand import CoachedHand
from conftest import session_of

from session.base.units import DEG, DEG_PER_HOUR, EARTH_RATE_RPS, MDPS
from session.bench.messages import Stage
from session.log.samples import joined
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.models.linear import BIAS, PARAMETERS, LinearModel
from tinygc.planning.proposals import TARGETS
from tinygc.planning.turns import PAIR_S, SINGLE_S
from tinygc.simulation.sensor import TEMPERATURE_SETTLES_S, Flicker

PER_C_RPS, LATITUDE, ODR_HZ = 5 * MDPS, 31.03 * DEG, 211.3
EARTH = EARTH_RATE_RPS * np.array([np.cos(LATITUDE), 0.0, np.sin(LATITUDE)])
WAITS_S = (0.0, 600.0)


class WarmingHand(CoachedHand):
    """The sensor has errors of 1 % and 5 mrad, a bias that drifts with temperature and flickers, and feels the Earth."""

    def __init__(self, seed: int, warm_c: float, waited_s: float):
        rng = np.random.default_rng(1000 + seed)
        self._per_c, self._bias = PER_C_RPS * rng.normal(size=3), np.clip(rng.normal(size=3), -2, 2) * DEG
        self.E = np.eye(3) + rng.normal(size=(3, 3)) * np.where(np.eye(3, dtype=bool), 0.01, 0.005)
        self._warm_c, self._waited_s = warm_c, waited_s
        self._flicker, self._truth = Flicker(3 * DEG_PER_HOUR, 3600.0, rng), list[np.ndarray]()
        super().__init__(seed=seed, odr_hz=ODR_HZ)
        self.guide.stop_at_target = True

    def measured(self, rate: np.ndarray, attitudes: Rotation, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The reading, and the temperature."""
        above_c = -self._warm_c * np.expm1(-(t_s + self._waited_s) / TEMPERATURE_SETTLES_S)
        bias = self._bias + self._per_c * above_c[:, None] + self._flicker(t_s)
        if np.abs(rate).max() > 0:
            self._truth.append(bias)
        felt = rate + attitudes.inv().apply(EARTH) + bias
        return felt @ np.linalg.inv(self.E).T, 25 + above_c + 0.01 * self._rng.normal(size=len(t_s))

    def rate_rps(self, vectors: list[np.ndarray]) -> float:
        """In the seconds that the coach's words ask for: at one speed for all turns a drift of the bias would look like a scale factor."""
        pair = self.guide.advice is not None and len(self.guide.advice.movements) > 1
        return float(np.linalg.norm(vectors, axis=1).sum()) / (PAIR_S if pair else SINGLE_S)

    @property
    def truth(self) -> np.ndarray:
        """(12,) the sensor's errors, B as its mean over the turns."""
        return LinearModel(self.E, -np.concatenate(self._truth).mean(axis=0)).vector


def one_session(job: tuple[int, float, float]) -> np.ndarray:
    """Turns, seconds, whether the verdict is a pass, then (12,) errors, sigmas of the fit, sigmas of the coach, in units of the targets."""
    hand = WarmingHand(*job)
    guide = hand.until(lambda guide: guide.stage is Stage.DONE)
    result = fit_session(session_of(joined(hand.received), raw=False), FitOptions(methods=("least_squares",)))
    errors = (result.methods["least_squares"].linear.vector - hand.truth) / TARGETS
    stated = np.sqrt(np.diag(result.covariance)) / TARGETS
    return np.concatenate(
        [[guide.accepted, guide.now_s, result.verdict().answer == "pass"], errors, stated, [sigma for _, sigma in guide.advice.sigmas]]
    )


def main() -> None:
    command = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    command.add_argument("--seeds", type=int, default=24)
    command.add_argument("--warm", type=float, default=5.0, help="degC")
    args = command.parse_args()
    jobs = [(seed, args.warm, waited_s) for waited_s in WAITS_S for seed in range(args.seeds)]
    found = np.array(in_parallel(one_session, jobs, "session")).reshape(len(WAITS_S), args.seeds, -1)
    rows = []
    for waited_s, each in zip(WAITS_S, found, strict=True):
        errors, stated, planned = each[:, 3:].reshape(args.seeds, 3, PARAMETERS).swapaxes(0, 1)
        for name, which in (("E", slice(0, BIAS.start)), ("B", BIAS)):
            error, sigma = errors[:, which], stated[:, which]
            rows.append((
                f"{waited_s / 60:g} min", f"{np.median(each[:, 0]):.0f} ({each[:, 0].max():.0f})",
                f"{np.median(each[:, 1]):.0f} s ({each[:, 1].max():.0f} s)", f"{each[:, 2].sum():.0f} of {args.seeds}", name,
                f"{np.sqrt(np.mean(error**2)):.2f}",
                f"{np.sqrt(np.mean((error / planned[:, which]) ** 2)):.2f}", f"{np.median(sigma):.2f}",
                f"{100 * np.mean(np.abs(error) < sigma):.0f} %, {100 * np.mean(np.abs(error) < 2 * sigma):.0f} %",
            ))  # fmt: skip
    head = ("waited", "turns (most)", "takes (most)", "pass", "of", "error, targets rms", "error, coach's sigmas rms",
            "sigma of fit, targets", "within 1, 2 sigmas")  # fmt: skip
    print(markdown(head, rows))


if __name__ == "__main__":
    main()
