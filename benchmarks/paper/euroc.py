"""EuRoC for the paper's tables: the training windows and the test sequences, each through a session folder."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from public.euroc import write_sequences, write_training_windows

from paper.levelled import Levelled, level_days
from session.base import rotation
from session.base.rotation import steps
from session.base.units import DEG
from session.log.folder import read_session
from session.log.samples import Samples
from tinygc.closure.build import build_problem
from tinygc.closure.problem import Problem
from tinygc.closure.residual import RateMap
from tinygc.features.truth.reading import Truth
from tinygc.features.truth.segments import moments_inside

EUROC = Path(__file__).resolve().parents[3] / "shared" / "euroc"
TEST = ("MH_02", "MH_04", "V1_01", "V1_03", "V2_02")


@dataclass(frozen=True, eq=False)
class Euroc:
    """training: the 243 windows; with_mislabelled: all 261; tests by name: whole sequences, in segments of 5 s; days: the training windows
    with a bias for each sequence."""

    training: Problem
    with_mislabelled: Problem
    tests: dict[str, Problem]
    days: Levelled

    def errors_deg(self, model) -> np.ndarray:
        """AOE (5,) of one model, or of one for each test sequence (by name), in degrees."""
        each = model if isinstance(model, dict) else dict.fromkeys(self.tests, model)
        return np.array([sequence_error_deg(problem, each[name]) for name, problem in self.tests.items()])


def sequence_error_deg(problem: Problem, model) -> float:
    """AOE of a whole sequence, in degrees: sqrt(mean |log(R_true^T R_carried)|^2) over all moments (Brossard et al. 2020)."""
    session = problem.session
    _, error = orientation_error(session.logs[0].samples, session.reference.truths[0], model)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1)))) / DEG


def orientation_error(samples: Samples, truth: Truth, model: RateMap) -> tuple[np.ndarray, np.ndarray]:
    """Orientation error at the truth's moments within the log: t_s (K,) since the first, and rotation vectors (K, 3) rad in body axes.

    ``model`` maps measured rates (N, 3) to calibrated ones.  Raises DataError if truth and log do not share their times.
    """
    rows, q_true = moments_inside(samples, truth)
    part = samples.between(int(rows[0]), int(rows[-1]) + 1)
    # The model runs over the whole log, since it may have memory.
    rate = np.asarray(model(samples.gyro))[rows[0] : rows[-1] + 1]
    running = rotation.accumulate(steps(rate, part.dt_s))
    q = np.concatenate([q_true[:1], rotation.multiply(q_true[0], running)])[rows - rows[0]]
    return part.t_s[rows - rows[0]], rotation.log(rotation.multiply(rotation.conjugate(q_true), q))


@contextmanager
def euroc_folders() -> Iterator[Path]:
    """A place for session folders, gone afterwards."""
    with tempfile.TemporaryDirectory(prefix="tinygc-euroc-") as parent:
        yield Path(parent)


def read_euroc(parent: Path) -> Euroc:
    """Write the session folders below ``parent``, and read them as any other."""
    training = build_problem(read_session(write_training_windows(EUROC, parent / "training")))
    return Euroc(
        training=training,
        with_mislabelled=build_problem(read_session(write_training_windows(EUROC, parent / "all", mislabelled=True))),
        tests={name: read_sequence(parent, name) for name in TEST},
        days=level_days(training),
    )


def read_sequence(parent: Path, name: str, segment_s: float = 5.0) -> Problem:
    """A whole sequence."""
    return build_problem(read_session(write_sequences(EUROC, [name], parent / name, segment_s)))
