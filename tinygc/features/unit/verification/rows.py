"""Everything measured today, compared with the old calibration: closures of turns, rates and lengths of gravity in stills.

With d the change of the 21 parameters from the old calibration to what the sensor is today,

    r = -A d + noise,        r: recorded less predicted by the old calibration,        A: derivative of r by the parameters

A recording with turns is replayed by the twin (``tinygc/noise/twin.py``); of one with rests alone the stills are taken.  The residuals are
linear about today's own first fit, so that a large change is not spoilt by what is quadratic in it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from session.base import rotation
from session.base.errors import DataError, FitError, SegmentError
from session.base.names import CLOCKS
from session.base.progress import Reporter, no_report
from session.base.texts import printable
from session.base.units import G
from session.detect.accelerometer import IDENTITY, force_of, length_columns, times_of, units
from session.detect.axes import agreement
from session.detect.check_samples import with_bridges
from session.detect.findings import stop_at_errors
from session.detect.first_look import check_session
from session.detect.signatures import CAUSES
from session.detect.stills import SessionStills, Still, references
from session.log.folder import Session
from tinygc.closure.earth import no_earth, unseen_covariance, vertical_only
from tinygc.closure.floor import UNKNOWN, bias_instability_of
from tinygc.closure.least_squares import GaussianPrior
from tinygc.closure.prepared import prepare
from tinygc.closure.problem import Problem
from tinygc.closure.stills import StillSet
from tinygc.effects import catalogue, per_axis
from tinygc.estimation.spread import ACCELEROMETER, COUNT, GYROSCOPE
from tinygc.fitting.unit_state import UnitState
from tinygc.inference.noise import Prior, Sparse, wander_covariance
from tinygc.inference.solve import root
from tinygc.models.linear import MATRIX, PRIOR_SIGMA, LinearModel
from tinygc.noise.components import WANDER, Component, SessionNoise, Undersampling, first_noise
from tinygc.noise.twin import Twin
from tinygc.noise.whitening import ACCEL_INSTABILITY_MPS2, PRECALIBRATION_MPS2, Whitener

#: rows of each kind
CLOSURE, STILL, LENGTH = "closure", "still", "length"
#: m/s^2: gravity at a site that session.toml gives is known to this, one sigma: 30 m of height, or what a formula leaves
SITE_MPS2 = 1e-4
#: name of the first look's check of one factor on all rates; of those that a minute at rest has to pass
SCALE, OF_RESTS = "gyro scale", ("gravity", "gyro stuck", "accelerometer stuck", "gyro dead", "accelerometer dead", *CAUSES)
#: degrees: a recording without a larger turn is one of rests: a change of E by 1 % shows by a tenth of the usual limit in it
LEAST_TURN_DEG = 10.0
#: profile in time: from seconds of the session (N,) to (N,) of no unit
Profile = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Rows:
    """Today's measurements as n rows.

    r (n,): rad, rad/s, m/s^2; parameters (n, 21): their derivative by the accelerometer's correction and by the linear model's vector;
    spans_s (n,): duration of each row's turn, 1 of other rows;
    known (n, k): what is uncertain in the references, one sigma each: the Earth's rate, gravity's length; white (n, n): white noise;
    noise: beyond white, whose sizes are estimated; kinds: rows of each kind; blank (n,) bool: rows without data; duration_s of
    the session; temp_c: mean over its stills, NaN where not known; stills, turns: how many; noise_freedom: degrees of freedom of the white
    noise; rest_rps (3,): what the gyroscope reads at rest; session as it was compared; steps_s: seconds at which a step is looked for;
    in_time: columns (n, 3) of a change of B that follows a profile in time; twin: of a recording with turns; remark: why the first look
    refuses the rates, where it does.
    """

    r: np.ndarray
    parameters: np.ndarray
    known: np.ndarray
    spans_s: np.ndarray
    white: np.ndarray
    noise: SessionNoise
    kinds: dict[str, slice]
    blank: np.ndarray
    duration_s: float
    temp_c: float
    stills: int
    turns: int
    noise_freedom: float
    rest_rps: np.ndarray
    session: Session
    steps_s: np.ndarray
    in_time: Callable[[Profile], np.ndarray] = field(repr=False)
    twin: Twin | None = None
    remark: str = ""

    def covariance(self, noise: SessionNoise) -> np.ndarray:
        """(n, n) of white noise and of noise beyond it."""
        return self.white + noise.covariance

    def warmer_than(self, old: UnitState) -> float | None:
        """K by which the sensor is warmer than in the old session; None where it is not known of both."""
        return None if old.temperature_c is None or not np.isfinite(self.temp_c) else self.temp_c - old.temperature_c

    def effect(self, name: str) -> np.ndarray | None:
        """(n, P) columns of an effect of the catalogue; None without turns."""
        if self.twin is None:
            return None
        twin, start = self.twin, self.twin.start()
        rates = twin.rates(start)
        return twin.effect_columns(catalogue()[name], start, twin.sensitivity(start, rates), rates).stacked()


def facts(old: UnitState, session: Session) -> list[str]:
    """Settings that differ, a sentence each: range, rate, model, serial number of the sensor."""
    found, sensor = [], session.config.sensor
    for key, unit, words in (
        ("gyro_fs_dps", "dps", "full scale of the gyroscope"),
        ("accel_fs_g", "g", "full scale of the accelerometer"),
        ("odr_hz", "Hz", "data rate"),
    ):
        then, now = old.sensor.get(key), getattr(sensor, key)
        if then is not None and np.isfinite(now) and abs(then / now - 1) > 0.01:
            found.append(f"{words}: {then:g} {unit} in the model, {now:g} {unit} today")
    for key in ("model", "serial"):
        then, now = old.sensor.get(key), getattr(sensor, key)
        if then and now and now != "unknown" and then != now:
            found.append(f"{key} of the sensor: {printable(str(then))} in the model, {printable(now)} today")
    return found


def clocks_apart(old: UnitState, session: Session) -> str:
    """That the model goes by another clock than the session can go by; empty where both go by the same."""
    if old.clock == CLOCKS[0] or (session.config.sensor.clock_ratio is not None and session.reference is None):
        return ""
    why = "its sensor.clock_ratio is not known" if session.reference is None else f"its {session.reference.title}s do"
    return f"Model by the computer's clock, today's recording by the board's: {why}"


def readings_by(old: UnitState, session: Session) -> Session:
    """The session by a calibration's clock and with its accelerometer, and, for a model that is not linear, with calibrated rates as
    readings."""
    if not clocks_apart(old, session):
        session = session.on_clock(old.clock)
    # How far the board's clock is off is in both alike: only what its measurement leaves open may differ.
    config = replace(session.config, sensor=replace(session.config.sensor, clock_ratio=None))
    if old.accelerometer is not None:
        config = replace(config, accelerometer=replace(old.accelerometer, source="given", own_stills=False))
    found = replace(session, config=config)
    if isinstance(old.model, LinearModel):
        return found
    model = old.model.at_end()
    logs = tuple(replace(log, samples=replace(log.samples, gyro=model.calibrate(found.calibrated(log)))) for log in found.logs)
    return replace(found, logs=logs)


def rows_of(session: Session, old: UnitState, use_earth: bool = True, progress: Reporter = no_report) -> Rows:
    """Compare a session with the old calibration.  Raises SegmentError without a rest, and the errors of ``prepare``."""
    session = readings_by(old, session)
    vector = old.linear.vector
    prior = GaussianPrior(vector, np.diag((PRIOR_SIGMA / 4) ** 2), np.ones(len(vector), dtype=bool))
    if session.reference is None:
        found = SessionStills(whole := with_bridges(session))
        if not any(references(found.of(log).stills) for log in whole.logs):
            _stop_at_errors_of_rests(whole, found)
            raise SegmentError(f"{session.folder}: no rest of {session.config.protocol.still_s:g} s; let the sensor lie still for a minute")
        if all(len(found.of(log).stills) < 2 for log in whole.logs):
            return _of_rests(whole, old, found)
    mode, factor, remark = "given" if session.config.accelerometer.source == "given" else "auto", 1.0, ""
    for again in (False, True):
        try:
            prepared = prepare(
                _scaled(session, factor),
                use_earth=use_earth,
                accelerometer=mode,
                near=old.linear,
                prior=lambda start: prior,
                progress=progress,
            )
            turns = [segment.turn_deg for segment in prepared.problem.segments]
            if session.reference is None and not remark and max(turns) < LEAST_TURN_DEG:
                return _of_rests(whole, old, found)
            return _of_turns(prepared.problem, old, session, factor, remark)
        except (SegmentError, FitError):  # too few turns, or such as bind nothing
            if session.reference is not None:
                raise
            return _of_rests(whole, old, found)
        except DataError as error:
            # Rates that are wrong by one factor are refused by the first look; here they are an answer.
            if again or SCALE not in str(error) or session.reference is not None:
                raise
            factor, remark = _factor(whole, found), str(error)
    raise AssertionError


def _stop_at_errors_of_rests(session: Session, found: SessionStills) -> None:
    """Raise DataError where the first look finds a wrong unit of the accelerometer, or an axis without noise."""
    stop_at_errors([finding for finding in check_session(session, found) if finding.what in OF_RESTS])


def _scaled(session: Session, factor: float) -> Session:
    """The session with all rates times a factor."""
    if factor == 1.0:
        return session
    logs = tuple(replace(log, samples=replace(log.samples, gyro=np.asarray(log.samples.gyro) * factor), raw=False) for log in session.logs)
    sensor = session.config.sensor
    config = replace(session.config, sensor=replace(sensor, gyro_fs_dps=sensor.gyro_fs_dps * factor))
    return replace(session, logs=logs, config=config)


def _factor(session: Session, found: SessionStills) -> float:
    """What gravity's movement asks of all rates; 1 where it does not move."""
    scales = [agreement(found.of(log).samples, found.of(log).stills) for log in session.logs]
    known = [each.scale for each in scales if each is not None]
    return float(np.median(known)) if known else 1.0


def _of_turns(problem: Problem, old: UnitState, session: Session, factor: float, remark: str) -> Rows:
    """Rows of a recording with turns; factor: on all rates, without which the first look refuses them for this remark."""
    twin = Twin(problem)
    start = twin.start()
    rates = twin.rates(start)
    site = problem.session.config.site
    whiten = Whitener(twin)
    noise = first_noise(twin, whiten)
    n, stills = len(whiten.white), len(twin.stills)
    parameters = np.zeros((n, COUNT))
    parameters[:, GYROSCOPE] = twin.linear_columns(twin.sensitivity(start, rates)).stacked()
    lengths = whiten.parts[LENGTH]
    then = old.linear.vector.copy()
    then[MATRIX] /= factor  # the same calibration of rates times the factor
    r = twin.residuals(start, rates).stacked() + parameters[:, GYROSCOPE] @ (then - start.model.vector)
    parameters[:, GYROSCOPE][:, MATRIX] /= factor
    if stills:
        parameters[:, ACCELEROMETER] = -twin.own_columns() / units(G)
        r[lengths] += start.gravity_mps2 - site.expected_gravity_mps2
    earth = twin.earth_columns().stacked() @ root(unseen_covariance(problem.earth, site.latitude_deg))
    gravity = np.zeros((n, 1))
    gravity[lengths] = np.hypot(site.gravity_sigma_mps2, SITE_MPS2)
    known = [earth, gravity]
    if (clock := problem.session.clock) is not None:
        known.append(parameters[:, GYROSCOPE] @ root(clock.covariance(old.linear.vector)))
    blank = np.zeros(n, dtype=bool)
    blank[whiten.parts[CLOSURE]] = ~twin.batch.known.ravel()
    spans_s = np.ones(n)
    spans_s[whiten.parts[CLOSURE]] = np.repeat([segment.duration_s for segment in twin.segments], twin.batch.known.shape[1])
    allowances = twin.precalibration_columns(start, rates).stacked() * PRECALIBRATION_MPS2 if stills else np.zeros((n, 0))
    times = np.array([twin.movements[s.log].t_s[s.start] + s.duration_s / 2 for s in twin.segments])

    def in_time(profile: Profile) -> np.ndarray:
        def basis(movement):  # type: ignore[no-untyped-def]
            return profile(movement.t_s)[:, None]

        effect = replace(catalogue()["gyro.bias_drift"], columns=per_axis(basis), basis=basis, scan=None)
        return twin.effect_columns(effect, start, twin.sensitivity(start, rates), rates).stacked()

    return _rows(
        session,
        [still for _, still in twin.stills],
        factor,
        r=r,
        parameters=parameters,
        known=np.concatenate(known, axis=1),
        spans_s=spans_s,
        white=whiten.white - allowances @ allowances.T,
        noise=replace(noise, blocks=[np.arange(n)]),
        kinds=dict(whiten.parts),
        blank=blank,
        duration_s=float(problem.began_s[-1]),
        turns=len(twin.segments),
        remark=remark,
        steps_s=times,
        in_time=in_time,
        twin=twin,
    )


def _of_rests(session: Session, old: UnitState, found: SessionStills) -> Rows:
    """Rows of a recording with rests alone: rates and lengths.  Its noise is the bias' drift between stills, with its source's prior."""
    _stop_at_errors_of_rests(session, found)
    logs = [StillSet.of(each.samples, each.stills, each.noise) for each in map(found.of, session.logs) if each.noise is not None]
    by_log = [references(log.stills) for log in logs]
    stills = [still for own in by_log for still in own]
    site, force, q = session.config.site, force_of(stills), len(stills)
    middle_s, duration_s = times_of(by_log, [log.samples for log in logs])
    n, still, length = 4 * q, slice(0, 3 * q), slice(3 * q, 4 * q)
    turn = rotation.matrix(rotation.from_gravity(force))
    earth = no_earth() if site.latitude_deg is None else vertical_only(site.latitude_deg)
    rate, spans_s = np.array([s.gyro_mean for s in stills]), np.array([s.duration_s for s in stills])
    parameters, known, white, drift = np.zeros((n, COUNT)), np.zeros((n, 4)), np.zeros(n), np.zeros((n, n))
    parameters[still, GYROSCOPE] = np.concatenate([np.hstack([np.kron(np.eye(3), each), np.eye(3)]) for each in rate])
    parameters[length, ACCELEROMETER] = length_columns(IDENTITY, force)
    known[still, :3] = (-turn.transpose(0, 2, 1)).reshape(-1, 3) @ root(unseen_covariance(earth, site.latitude_deg))
    known[length, 3] = np.hypot(site.gravity_sigma_mps2, SITE_MPS2)
    noises = [log.noise for log, own in zip(logs, by_log, strict=True) for _ in own]
    white[still] = np.concatenate([noise.angle_random_walk**2 / span for noise, span in zip(noises, spans_s, strict=True)])
    lengths = np.array([np.mean(noise.velocity_random_walk**2) for noise in noises])
    white[length] = lengths / spans_s + ACCEL_INSTABILITY_MPS2**2
    drift[still, still] = np.kron(wander_covariance(middle_s, spans_s, instability_rps=1.0), np.eye(3))
    instability = bias_instability_of(session.config.sensor, logs, {0: earth})
    usual = instability.source != UNKNOWN and instability.rps > 0
    rps = instability.rps if usual else float(np.sqrt(np.median(white[still])))
    wander = Component(WANDER, Sparse.of(drift), rps, "rad/s", 1.0, "bias drift", Prior(rps, 0.5))
    none = Undersampling(np.zeros(0), 1.0, np.zeros(0), float("nan"))

    def in_time(profile: Profile) -> np.ndarray:
        columns = np.zeros((n, 3))
        inside = [np.mean(profile(np.linspace(at - span / 2, at + span / 2, 21))) for at, span in zip(middle_s, spans_s, strict=True)]
        columns[still] = -np.kron(np.array(inside)[:, None], np.eye(3))
        return columns

    return _rows(
        session,
        stills,
        r=np.r_[
            (old.linear(rate) - np.einsum("qji,j->qi", turn, earth.rate_t)).ravel(),
            np.linalg.norm(force, axis=1) - site.expected_gravity_mps2,
        ],
        parameters=parameters,
        known=known,
        spans_s=np.ones(n),
        white=np.diag(white),
        noise=SessionNoise((wander,), [np.arange(n)], none, np.zeros(1), np.zeros(1)),
        kinds={CLOSURE: slice(0, 0), STILL: still, LENGTH: length},
        blank=np.zeros(n, dtype=bool),
        duration_s=duration_s,
        turns=0,
        steps_s=(middle_s[1:] + middle_s[:-1]) / 2,
        in_time=in_time,
    )


def _rows(session: Session, rests: list[Still], factor: float = 1.0, **own: Any) -> Rows:
    """Rows of a session with these rests; factor: on their rates.  The degrees of freedom of the white noise are those of blocks of 0.1 s
    with a filter's correlation, as in ``noise.channels``."""
    temps, rates = np.array([still.temp_c for still in rests]), [still.gyro_mean for still in rests]
    return Rows(
        session=session,
        stills=len(rests),
        temp_c=float(np.mean(temps)) if rests else float("nan"),
        rest_rps=np.mean(rates, axis=0) / factor if rests else np.zeros(3),
        noise_freedom=max(3.0, 3 * sum(still.duration_s for still in rests) / 0.1 * 0.66),
        **own,
    )
