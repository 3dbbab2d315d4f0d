"""What a truth file shows beyond names: growth of the closure, neighbours, clock and frame, the accelerometer, the rests."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from session.base import rotation
from session.base.numeric import sigma_of
from session.base.units import DEG, MG
from session.detect.findings import xyz_text
from session.detect.segments import Segment
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.problem import REPORTED_SIGMAS, Problem
from tinygc.closure.residual import closure_angles
from tinygc.effects import AppliedEffect, movement_of
from tinygc.explanation.claims import Claim, claim_of, common_delays
from tinygc.explanation.data_repair import RepairedProblem
from tinygc.features.truth.alignment import alignment_table
from tinygc.features.truth.check import frame_text, mounting_text, offset_text
from tinygc.features.truth.errors import FRAME, LIKE_AN_OUTAGE, MOUNTED, OFFSET, TRUTH, WRONG_MOMENTS, chance_of, neighbours, outages
from tinygc.features.truth.problem import batch_of
from tinygc.features.truth.reading import FOUND, TruthAlignment
from tinygc.features.truth.segments import TruthEnds, cut_at_truth, find_rests, moments_inside
from tinygc.inference.solve import solve
from tinygc.models.linear import LinearModel
from tinygc.noise.components import SessionNoise
from tinygc.noise.refit import Refit
from tinygc.noise.thinned import conditions
from tinygc.noise.twin import Twin
from tinygc.reporting.drawing import Axis, Panel

# Evidence of a truth file: growth of the closure, correlation of neighbours, the accelerometer, the rests.

#: segment lengths of the closure's growth, s
LENGTHS_S = (0.5, 1.0, 2.0, 4.0, 8.0)
#: averaging window of the specific force, over which a vehicle's own acceleration averages out: a change of speed below 0.5 m/s has a mean
#: of 5 mg at most
FORCE_WINDOW_S = 20.0


@dataclass(frozen=True, eq=False)
class Rests:
    """The zero-rate level at rest.  seconds at rest; difference (3,) rad/s of the zero at rest from that in motion, with its scatter sigma
    (3,); vibration_g2 at rest and in motion."""

    seconds: float
    difference: np.ndarray
    sigma: np.ndarray
    vibration_g2: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Force:
    """Apparent bias (3,) m/s^2 of the accelerometer against the truth's attitude, with the truth's frame as recorded and rotated as the
    gyro shows; sigma (3,)."""

    bias: np.ndarray
    turned: np.ndarray
    sigma: np.ndarray


def _again(problem: Problem, segment_s: float) -> list[tuple[Segment, TruthEnds]]:
    """Cut the same session at another segment length, within the used segments."""
    session, protocol = problem.session, replace(problem.session.config.protocol, segment_s=segment_s)
    cut = []
    for number, (log, truth) in enumerate(zip(problem.logs, session.reference.truths, strict=True)):
        used = [(s.start, s.stop) for s in problem.used if s.log == number]
        for segment, ends in cut_at_truth(log.samples, truth, session.config.sensor, protocol, log=number):
            inside = any(a <= segment.start and segment.stop <= b for a, b in _joined(used))
            if segment.accepted and inside:
                cut.append((segment, ends))
    return cut


def _joined(spans: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Merge consecutive spans."""
    joined: list[tuple[int, int]] = []
    for a, b in spans:
        if joined and joined[-1][1] - 1 >= a:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    return joined


def growth(problem: Problem, model: LinearModel) -> tuple[np.ndarray, np.ndarray]:
    """Lengths (L,) s that the truth's moments allow, and the closure's robust rms (L, 3) rad at each, about the table's axes."""
    lengths, closures = [], []
    for length in LENGTHS_S:
        cut = _again(problem, length)
        # With fewer segments the scatter is not known to 40 %; a tenth in length is a twentieth in the noise's growth.
        if len(cut) < 8 or abs(np.median([s.duration_s for s, _ in cut]) / length - 1) > 0.1:
            continue
        batch = batch_of(problem.logs, [s for s, _ in cut], [ends for _, ends in cut])
        angles = closure_angles(batch, model)
        lengths.append(length)
        closures.append(sigma_of(angles - np.median(angles, axis=0)))
    return np.array(lengths), np.array(closures).reshape(-1, 3)


def neighbours_correlation(problem: Problem, angles: np.ndarray) -> float:
    """Correlation of neighbouring segments' errors (S, 3): -1/2 if moments of truth are wrong, 0 if the gyro is noisy, more if its bias
    drifts."""
    at = neighbours(problem)
    if len(at) < 5:
        return float("nan")
    size = np.median(np.linalg.norm(angles, axis=1))
    angles = angles * np.minimum(1, 3 * size / np.maximum(np.linalg.norm(angles, axis=1), 1e-12))[:, None]
    return float(np.sum(angles[at] * angles[at + 1]) / np.sqrt(np.sum(angles[at] ** 2) * np.sum(angles[at + 1] ** 2)))


def force_against_truth(problem: Problem, stands: np.ndarray, turned: np.ndarray) -> Force | None:
    """Compare the mean specific force with the truth's vertical in long windows, over which a vehicle's acceleration averages out. stands,
    turned (3, 3): from the sensor's axes to those of the problem's attitudes, with the truth as recorded and rotated as the gyro shows."""
    rows, values = [], []
    g = problem.session.config.site.expected_gravity_mps2
    for log, truth in zip(problem.logs, problem.session.reference.truths, strict=True):
        at, q = moments_inside(log.samples, truth)
        t_s, force = log.samples.t_s[at], log.samples.accel[at]
        size = int(FORCE_WINDOW_S / np.median(np.diff(t_s)))
        turn, has = rotation.matrix(q), np.abs(force).sum(axis=1) > 0
        both = np.stack([force @ stands.T, force @ turned.T], axis=-1)
        for start in range(0, len(at) - size if size > 10 else 0, size // 2):
            part = slice(start, start + size)
            if has[part].all() and t_s[part.stop - 1] - t_s[start] <= 1.1 * FORCE_WINDOW_S:
                weighed = (np.hanning(size) / np.hanning(size).sum())[:, None, None] * turn[part]
                rows.append(weighed.sum(axis=0))
                values.append(np.einsum("tij,tjk->ik", weighed, both[part]) + np.array([[0.0], [0.0], [g]]))
    if len(rows) < 3:
        return None
    # The unknowns are a bias in the body frame, and a tilt of the truth's world frame, of half a degree.
    tilt = np.tile(np.array([[0, g], [-g, 0], [0, 0]]), (len(rows), 1, 1))
    A, y = np.concatenate([np.array(rows), tilt], axis=2).reshape(-1, 5), np.array(values).reshape(-1, 2)
    prior = 0.05 * np.diag([1e-3] * 3 + [1 / (0.5 * DEG)] * 2)
    found = solve(np.vstack([A, prior]), np.vstack([y, np.zeros((5, 2))]))
    scatter = np.sum((y[:, 0] - A @ found.shortest[:, 0]) ** 2) / max(len(y) - 5, 1)
    bias, as_turned = found.shortest[:3].T
    return Force(bias, as_turned, np.sqrt(np.diag(found.spread)[:3] * scatter))


def zero_at_rest(problem: Problem, model: LinearModel) -> Rests | None:
    """The zero-rate level at rest compared with that in motion, from the gyro's own readings."""
    rates, weights, quiet, shaken = [], [], [], []
    for log in problem.logs:
        movement = movement_of(log.samples, model(log.samples.gyro), conditions(problem))
        moving = np.ones(len(log.samples), dtype=bool)
        for part, rate in find_rests(log.samples):
            rates.append(np.asarray(model(rate[None]))[0])
            weights.append(part.stop - part.start)
            quiet.append(float(movement.vibration_g2[part].mean()))
            moving[part] = False
        shaken.append(float(np.median(movement.vibration_g2[moving])))
    if not rates:
        return None
    mean = np.average(rates, axis=0, weights=weights)
    scatter = np.std(rates, axis=0, ddof=1) / np.sqrt(len(rates)) if len(rates) > 1 else np.full(3, np.nan)
    seconds = sum(weights) * problem.logs[0].samples.period_s
    return Rests(float(seconds), mean, scatter, (float(np.average(quiet, weights=weights)), float(np.mean(shaken))))


# Claims of what was found before any fit, and all of it in words, as JSON and as a chart.

#: share of the gyro's own noise, which an independent truth cannot follow: two sigmas of the rms of 100 angles
OWN_NOISE_SHARE = 0.85
CANNOT = (
    "cannot know: an error of the gyro's sensitivity from one of the truth's scale of angles; a common rotation of gyro and accelerometer "
    "from one of the truth's body; temperature, which is not recorded; clocks of gyro and accelerometer, where no still gives gravity"
)


class TruthShown:
    """What a truth file shows beyond names.

    twin: of the problem without wrong moments; fit: with what is named; its noise.  lengths_s (L,), closure_rad (L, 3): growth.
    truth_rad: noise of a moment.  gyro_rad per root second: the gyro's own walk at its quietest.  neighbours: correlation of neighbouring
    segments' errors, before and after.  rests; force.
    """

    def __init__(self, repaired: RepairedProblem, twin: Twin, first: Refit, fit: Refit, noise: SessionNoise):
        self.twin, self.fit, self._jumps = twin, fit, repaired.found.get(WRONG_MOMENTS)
        problem, self.alignment = twin.original, twin.problem.session.reference.alignment
        model = fit_least_squares(problem.batch, problem.floor.sigma, problem.first).model
        self.lengths_s, self.closure_rad = growth(problem, model)
        self.truth_rad = noise.size(TRUTH)
        self.gyro_rad = float(np.mean(problem.noise.angle_random_walk))
        before, after = (neighbours_correlation(problem, twin.residuals(each.state).closure) for each in (first, fit))
        self.neighbours = before, after
        self.rests = zero_at_rest(problem, model)
        self.force = force_against_truth(problem, *_stands_and_turned(self.alignment))

    @property
    def offset(self) -> tuple[float, float]:
        """Offset of the truth's clock, s, and its sigma: what was found before the fit, and what the fit leaves of it."""
        found = self.alignment.reading.offset_s if self.alignment.source["offset_s"] == FOUND else 0.0
        for number, claim in enumerate(self.fit.state.claims):
            if claim.effect is OFFSET:
                return found + float(claim.theta[0]), float(np.sqrt(self.fit.theta_covariance(number)[0, 0]))
        return found, self.alignment.offset_sigma_s

    @property
    def measured(self) -> dict[str, tuple[np.ndarray, np.ndarray] | None]:
        """As of an ``Explanation``: the offset of the truth's clock, None where it is not known."""
        value, sigma = self.offset
        if not value:
            value, sigma = self.alignment.offset_s, self.alignment.offset_sigma_s
        return {OFFSET.id: (np.array([value]), np.array([[sigma**2]])) if np.isfinite([value, sigma]).all() else None}

    def all_claims(self, claims: list[Claim]) -> list[Claim]:
        """All claims: these, and what was found before the fit.  The clock is stated as recorded, and where it was fitted for a delay alone
        only if it is there."""
        named = next((claim for claim in claims if claim.effect is OFFSET), None)
        value, sigma = self.offset
        if abs(value) > REPORTED_SIGMAS * sigma or named is not None:
            applied, p_value = AppliedEffect(OFFSET, np.array([value])), float(chdtrc(1, (value / sigma) ** 2))
            clock = claim_of(applied, np.array([[sigma**2]]), p_value, equivalent=common_delays())
            if named is not None:
                p_value = min(p_value, named.p_value)
                fields: dict[str, Any] = {"parameters": clock.parameters, "std": clock.std, "description": clock.description}
                clock = replace(named, **fields, p_value=p_value, equivalent=clock.equivalent)
            claims = [clock if claim is named else claim for claim in claims] + ([clock] if named is None else [])
        return outage_claims(self.twin.problem) + _frame_claim(self.alignment, self.force) + claims

    @property
    def independent(self) -> bool | None:
        """Whether the closure over the shortest length is as large as the gyro's own noise; a truth file estimated with this gyro follows
        that noise.  None if the noise is unknown, because the gyro is never still."""
        if not len(self.lengths_s) or not len(self.twin.problem.stills):
            return None
        return bool(np.sqrt(np.mean(self.closure_rad[0] ** 2)) > OWN_NOISE_SHARE * self.gyro_rad * np.sqrt(self.lengths_s[0]))

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Subject of each line of evidence (empty: the same as above), and its statement."""
        grown = "; ".join(f"{t:g} s: {np.sqrt(np.mean(row**2)) / DEG:.3f}" for t, row in zip(self.lengths_s, self.closure_rad, strict=True))
        before, after = self.neighbours
        rows = [
            ("truth", f"{len(self._moments)} wrong moments; {len(self._outages)} outages; closure per angle by length, degrees: {grown}"),
            ("", self._own_noise),
            ("", f"neighbouring segments correlate {before:+.2f}, after {after:+.2f} (-0.5: the truth's noise, 0: the gyro's, more: slow)"),
            ("clocks", f"truth {offset_text(self.alignment)}"),
            ("frames", f"gyro to truth {mounting_text(self.alignment)}; {frame_text(self.alignment)}"),
        ]
        if (force := self.force) is not None:
            off = f"accelerometer off by {xyz_text(force.bias / MG, 0)} mg ± {xyz_text(force.sigma / MG, 0)}"
            rows.append(("", f"{off}; turned as the gyro asks: {xyz_text(force.turned / MG, 0)}"))
        if (rests := self.rests) is not None:
            zero = f"zero-rate offset there less in motion {xyz_text(rests.difference / DEG, 3)} dps ± {xyz_text(rests.sigma / DEG, 3)}"
            rows.append(("rest", f"{rests.seconds:.0f} s; {zero}"))
            rows.append(("", f"vibration {rests.vibration_g2[0]:.4f} g² there, {rests.vibration_g2[1]:.4f} in motion"))
        rows = [(of, text if "nan" not in text else f"{text.split(' ')[0]}: not known, too few segments") for of, text in rows]
        return [*rows, ("limits", CANNOT)]

    @property
    def brief(self) -> list[str]:
        """Its lines of the first screen."""
        counts = f"{len(self._moments)} wrong moments, {len(self._outages)} outages"
        off = "" if self.force is None else f"{xyz_text(self.force.bias / MG, 0)} mg ± {xyz_text(self.force.sigma / MG, 0)}"
        return [f"Truth: {counts}; clock {offset_text(self.alignment)}.", *([f"Accelerometer off by {off}."] if off else [])]

    @property
    def _own_noise(self) -> str:
        if not len(self.lengths_s):
            return "too few moments of truth to see the closure grow"
        if self.independent is None:
            return "the gyro is never still: its own noise is not known"
        own = self.gyro_rad / DEG * np.sqrt(self.lengths_s[0])
        too_good = "" if self.independent else ": more than is seen, so the truth follows this gyro's noise and was made with it"
        return f"the gyro's own noise would leave {own:.4f}° after the shortest length{too_good}"

    @property
    def _moments(self) -> list[dict]:
        """Log and s of each wrong moment."""
        at_s = [] if self._jumps is None else self._jumps.parameters["at_s"]
        began = self.twin.problem.began_s
        logs = np.searchsorted(began, at_s, side="right") - 1
        return [{"log": int(log), "at_s": round(at - float(began[log]), 3)} for log, at in zip(logs, at_s, strict=True)]

    @property
    def _outages(self) -> list[dict]:
        return [
            {
                "log": log,
                "from_s": round(outage.from_s, 3),
                "to_s": round(outage.to_s, 3),
                "rms_dps": outage.size_rps / DEG,
                "times_usual": outage.times_usual,
                "of": "truth" if outage.sure else "truth or gyro",
            }
            for log, truth in enumerate(self.twin.problem.session.reference.truths)
            for outage in truth.outages
        ]

    def to_json(self) -> dict:
        """Its keys of ``tinygc-explain/2``."""
        force, rests = self.force, self.rests
        return {
            "truth": {
                "wrong_moments": self._moments,
                "outages": self._outages,
                "sigma_deg": self.truth_rad / DEG,
                "closure_deg_by_length_s": {f"{t:g}": row / DEG for t, row in zip(self.lengths_s, self.closure_rad, strict=True)},
                "gyro_noise_walk_deg_rts": self.gyro_rad / DEG,
                "neighbours_correlation": dict(zip(("before", "after"), self.neighbours, strict=True)),
                **alignment_table(self.alignment),
            },
            "force": None
            if force is None
            else {"bias_mg": force.bias / MG, "bias_turned_mg": force.turned / MG, "std_mg": force.sigma / MG},
            "rests": None
            if rests is None
            else {
                "seconds": rests.seconds,
                "zero_less_motion_dps": rests.difference / DEG,
                "vibration_g2": dict(zip(("rest", "motion"), rests.vibration_g2, strict=True)),
            },
        }

    @property
    def panels(self) -> list[Panel]:
        """Closure against the length of a segment: the truth's own noise is the same for each length, the gyro's grows as the root of it, a
        bias as the length."""
        if len(self.lengths_s) < 2:
            return []
        title = "Closure against length: a truth's noise stays, the gyro's grows as the root"
        panel = Panel(Axis("length of a segment (s)", log=True), Axis("closure (°)", log=True), title)
        if self.twin.problem.stills:  # a gyro that is never still shows vibration in its apparent noise
            panel.line(self.lengths_s, self.gyro_rad / DEG * np.sqrt(self.lengths_s), "floor", "dash", name="the gyro's own noise")
        for axis, closure in zip("xyz", self.closure_rad.T, strict=True):
            panel.points(self.lengths_s, closure / DEG, axis, name=axis)
        return [panel]


#: a rotation of the frame is claimed if it is this large (a zero-g offset of 10 mg turns the vertical by 0.6 deg, so that no accelerometer
#: could confirm less), this significant (by chance once in 60 000), and leaves at most this share of the accelerometer's bias (not
#: critical: as above)
FRAME_RAD, FRAME_SIGMAS, FRAME_LEAVES = 0.5 * DEG, 5.0, 0.7


def outage_claims(problem: Problem) -> list[Claim]:
    """Claim the outages that ``without_outages`` has found: those of the truth, and those that may be the gyro's."""
    began, claims = problem.began_s, []
    found = [(float(began[log]), outage) for log, truth in enumerate(problem.session.reference.truths) for outage in truth.outages]
    for sure in (True, False):
        here = [(start_s, outage) for start_s, outage in found if outage.sure == sure]
        if not here:
            continue
        spans_s = np.round([(start_s + outage.from_s, start_s + outage.to_s) for start_s, outage in here], 3).ravel()
        p_value = min(chance_of(outage.times_usual, outage.spans, outage.spans) for _, outage in here)
        effect = outages(len(here), [float(f"{outage.size_rps / DEG:.4g}") for _, outage in here], sure)
        claims.append(claim_of(AppliedEffect(effect, spans_s), None, p_value, equivalent=() if sure else LIKE_AN_OUTAGE))
    return claims


def _not_taken_off(alignment: TruthAlignment) -> np.ndarray:
    """(3,) rad of the rotation from the gyro's axes to the truth's body, beyond the mounting that the problem already includes."""
    if not np.isfinite(alignment.turned).all():
        return np.zeros(3)
    return (Rotation.from_matrix(alignment.reading.mounting).inv() * Rotation.from_rotvec(alignment.turned)).as_rotvec()


def _stands_and_turned(alignment: TruthAlignment) -> tuple[np.ndarray, np.ndarray]:
    """(3, 3) each: from the sensor's axes to those of the problem's attitudes, without an estimated mounting, and with the rotation
    estimated from the gyro."""
    found = Rotation.from_rotvec(_not_taken_off(alignment)).as_matrix()
    if alignment.source["mounting"] != FOUND:
        return np.eye(3), found
    return alignment.reading.mounting.T, found


def _frame_claim(alignment: TruthAlignment, force: Force | None) -> list[Claim]:
    """Claim a rotation of the truth's frame if the gyro shows more than its misalignment can be, or if the rotation reduces the
    accelerometer's apparent bias."""
    if not np.isfinite([alignment.turned, alignment.turned_sigma]).all():
        return []
    turned, sigma = _not_taken_off(alignment), alignment.turned_sigma
    effect = FRAME
    if alignment.source["mounting"] == FOUND:
        effect, turned = MOUNTED, alignment.turned
    sure = float(np.sum((turned / sigma) ** 2))
    if effect is FRAME and (
        force is None
        or float(np.linalg.norm(turned)) < FRAME_RAD
        or sure < FRAME_SIGMAS**2
        or np.linalg.norm(force.turned) > FRAME_LEAVES * np.linalg.norm(force.bias)
    ):
        return []
    return [claim_of(AppliedEffect(effect, turned), np.diag(sigma**2), float(chdtrc(3, sure)))]
