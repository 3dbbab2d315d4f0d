"""What to record next: the movement that reduces the largest uncertainty most."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from session.base import rotation
from session.base.errors import FormatError
from session.base.numeric import sigmas_in
from session.base.results import Keys, MapOf, Maybe, Text, read_required
from session.base.texts import printable
from session.base.units import DEG, STANDARD_GRAVITY_MPS2
from session.detect.accelerometer import IDENTITY, PARAMETERS, SCALES, length_columns
from session.detect.check_references import with_own_accelerometer
from session.detect.check_samples import with_bridges
from session.log.folder import Session, read_session, sha256_of
from tinygc.closure import residual
from tinygc.closure.build import build_problem
from tinygc.closure.joint import GIVEN_SIGMA_MG, REFUTED_P, fit_joint, recalibrated, tilt_columns
from tinygc.closure.problem import GYROSCOPE, Problem
from tinygc.closure.residual import Batch
from tinygc.closure.uncertainty import covariance_parts
from tinygc.estimation.accelerometer import JOINT_NAMES
from tinygc.estimation.stated_noise import prior_share, stated_joint_covariance, stated_noise
from tinygc.models import linear
from tinygc.planning import turns
from tinygc.planning.turns import SIDES, parts_from, up_words

# The next recording that the session's last explanation requests.

SHAPE = Keys({"schema": Text(("tinygc-explain/2",))}, {"next": Maybe(Text()), "logs": MapOf(Text())})


def requested_by_explain(folder: Path) -> str | None:
    """Return ``next`` of DIR/explain/explain.json; None without an explanation or a request, or where the logs have changed.

    FormatError for an explanation that cannot be read.
    """
    path = folder / "explain" / "explain.json"
    if not path.exists():
        return None
    explained = read_required(path, SHAPE, "explain again, or remove it")
    # Logs recorded since do not fulfil the request until they are explained, too.
    same = all(_sha256(folder, name) == sha256 for name, sha256 in explained.get("logs", {}).items())
    return printable(explained.get("next") or "") or None if same else None


def _sha256(folder: Path, name: str) -> str | None:
    """Return the hash of a file of this folder; None where there is none, or where the name leads elsewhere."""
    try:
        return sha256_of(folder / name) if Path(name).name == name else None
    except (FormatError, ValueError):  # an invalid file name
        return None


# A single turn about one body axis, from a still with some axis up, adds its own closure residual: two angles, linear in the gyroscope's 12
# parameters through the same sensitivity as all segments, and in the accelerometer's nine through the tilt at both ends.  Its two stills
# add the length of gravity in their attitudes.  It is rated by how much it lowers the variance of the parameter that is least certain
# relative to its target, of either sensor.

#: one sigma that a 40-segment session of an ASM330LHH reaches: a larger one justifies another turn
TARGETS = np.array([50e-6] * 9 + [2e-3 * DEG] * 3)
#: target of a given scale: its assumed accuracy, since gravity's length shows the common scale of all axes no better
GIVEN_SCALE = 1e-3 * GIVEN_SIGMA_MG
TURNS_DEG = (270, 225)  #: turns that end on a side, and on an edge
TURN_S, STILL_S, RATE_HZ = 3.0, 1.0, 100.0
MOST = 40  #: longest plan


@dataclass(frozen=True)
class Proposal:
    """A proposed movement: words for the operator; the parameter that it improves; its sigma now and after, in units of its target."""

    words: str
    parameter: str
    now: float
    after: float


def propose(where: Session | Path, count: int) -> tuple[list[Proposal], str | None, int | None]:
    """Plan after a session, or a session folder: proposals; the recording that `explain` requested, if any; how many such turns reach every
    target, None for more than ``MOST``.  Raises the errors of ``build_problem``."""
    session, _ = with_own_accelerometer(where if isinstance(where, Session) else read_session(where))
    session, _ = session.examined()
    all_turns = best_turns(known_of(build_problem(with_bridges(session))), MOST)
    enough = len(all_turns) if len(all_turns) < MOST else None
    requested = None if session.in_memory else requested_by_explain(session.folder)
    return all_turns[:count], requested, enough


@dataclass(frozen=True, eq=False)
class Known:
    """The uncertainty after a session: covariance (P, P), SI, of the accelerometer's nine parameters, where observed, then the gyroscope's
    12; estimated sigma_rad of a turn's angle and sigma_mps2 of a still's length; with_gravity: whether gravity's length is known; wanted
    (P,): targets in place of those of a calibration."""

    covariance: np.ndarray
    sigma_rad: float
    sigma_mps2: float = 0.0
    with_gravity: bool = False
    wanted: np.ndarray | None = None

    @property
    def names(self) -> list[str]:
        """Names of the parameters for display."""
        gyroscope = [parameter_words(name) for name in linear.NAMES]
        return gyroscope if len(self.covariance) == linear.PARAMETERS else [*JOINT_NAMES[:PARAMETERS], *gyroscope]

    @property
    def targets(self) -> np.ndarray:
        """Target (P,) of each sigma, SI."""
        if self.wanted is not None:
            return self.wanted
        if len(self.covariance) == linear.PARAMETERS:
            return TARGETS
        own = turns.TARGETS.copy()
        if not self.with_gravity:
            own[SCALES] = GIVEN_SCALE
        return np.concatenate([own, TARGETS])


def known_of(problem: Problem) -> Known:
    """Estimate the uncertainty of both sensors with all estimated noise; of the gyroscope alone where no stills show the accelerometer."""
    given = problem.session.config.accelerometer
    mode = "prior" if given.source == "given" else "fit"
    joint = fit_joint(problem, mode, given.sigma_mg or GIVEN_SIGMA_MG)
    if joint is not None and joint.p_value is not None and joint.p_value <= REFUTED_P:
        joint = fit_joint(problem, "fit")  # a rejected calibration is not used
    level = problem if joint is None else recalibrated(problem, joint)
    noise = None if joint is None else stated_noise(level)
    # Few turns leave directions to the prior, whose uncertainty is no noise.
    share = prior_share(level, problem.first if joint is None else joint.model)
    left = (share * linear.PRIOR_SIGMA**2) @ share.T
    if joint is None or noise is None:
        parts = covariance_parts(problem.batch, problem.floor, problem.first, problem.earth, wander=problem.wander)
        return Known(sum(parts.values()) + left, float(np.median(problem.floor.sigma[problem.batch.known])))
    rows = len(problem.used) * problem.batch.angles
    sigma_mps2 = float(np.median(1 / joint.system.root[rows:]))
    covariance = stated_joint_covariance(level, joint.model, noise)
    covariance[GYROSCOPE, GYROSCOPE] += left
    return Known(covariance, noise.tilt_rms / np.sqrt(2), sigma_mps2, joint.mode == "fit")


def parameter_words(name: str) -> str:
    """Return the display name of ``E_xy``."""
    kind, axes = name.split("_")
    if kind == "B":
        return f"bias of {axes}"
    return f"scale of {axes[0]}" if axes[0] == axes[1] else f"misalignment of {axes[0]} towards {axes[1]}"


def best_turns(known: Known, count: int) -> list[Proposal]:
    """Choose the best movement, then the best after that, …, until every parameter reaches its target."""
    targets, names = known.targets, known.names
    moves = [(move.words, _rows(move, known) * targets) for move in _moves()]
    information, proposals = np.linalg.inv(known.covariance / np.outer(targets, targets)), []
    for _ in range(count):
        sigma = sigmas_in(np.linalg.inv(information))
        worst = int(np.argmax(sigma))
        if sigma[worst] <= 1:
            break
        gains = [np.linalg.inv(information + J.T @ J)[worst, worst] for _, J in moves]
        words, J = moves[int(np.argmin(gains))]
        information = information + J.T @ J
        after = float(np.sqrt(np.linalg.inv(information)[worst, worst]))
        proposals.append(Proposal(words, names[worst], float(sigma[worst]), after))
    return proposals


@dataclass(frozen=True, eq=False)
class Move:
    """A movement: words; attitudes (2, 4) at its ends, the directions of force (2, 3) there; gyroscope (2, 12): columns of its closure."""

    words: str
    q_tb: np.ndarray
    up: np.ndarray
    gyroscope: np.ndarray


def _rows(move: Move, known: Known) -> np.ndarray:
    """Return the rows (r, P) of a move's closure and its stills' lengths, each in its own sigmas."""
    closes = move.gyroscope / known.sigma_rad
    if len(known.covariance) == linear.PARAMETERS:
        return closes
    force = move.up * STANDARD_GRAVITY_MPS2
    tilt = tilt_columns(move.q_tb, IDENTITY, force)[:, :2] / known.sigma_rad
    lengths = length_columns(IDENTITY, force) / known.sigma_mps2
    if not known.with_gravity:  # then only their difference is data
        lengths = (lengths[:1] - lengths[1:]) / np.sqrt(2)
    return np.concatenate(
        [np.concatenate([tilt[0] - tilt[1], closes], axis=1), np.pad(lengths, ((0, 0), (0, linear.PARAMETERS)))],
    )


def _moves() -> list[Move]:
    """Return moves from six stills about three axes in two senses: three quarters of a turn to a side, and five eighths to an edge."""
    found = []
    for up, turn_deg in product(SIDES, TURNS_DEG):
        for part in parts_from(up, turn_deg, TURN_S):
            words = f"from a still with {up_words(up)} up, turn {part.words} ({TURN_S:.0f} s)"
            start = rotation.from_gravity(up)  # an accelerometer reads +g along the axis that points up
            turn = part.axis * part.angle_rad
            q_tb = np.array([start, rotation.multiply(start, rotation.exp(turn))])
            found.append(Move(words, q_tb, np.array([up, part.up]), _columns(start, turn)))
    return found


def _columns(start: np.ndarray, turn: np.ndarray) -> np.ndarray:
    t = np.arange(0, TURN_S + 2 * STILL_S, 1 / RATE_HZ)
    phase = np.clip((t - STILL_S) / TURN_S, 0, 1)
    rate = (turn / TURN_S * 2 * np.sin(np.pi * phase)[:, None] ** 2)[None]
    dt = np.full((1, len(t) - 1), 1 / RATE_HZ)
    batch = Batch(rate, dt, np.zeros_like(rate), start[None], start[None], yaw_known=False)
    return linear.columns(residual.sensitivity(batch, rate), rate)[0, :2]
