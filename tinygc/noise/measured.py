"""Noise figures that were measured at rest (``noise.json``), for a session of the same unit.

They are the prior of the session's bias drift (``_session_instability``), and the session is held against them: its white noise
(``_white_comparisons``) and its bias drift (``_drift_comparison``).  A session's stills give its white noise to a percent, which a prior
would not improve: N is compared, and no prior.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.names import is_special
from session.base.units import DEG_PER_HOUR, DEG_PER_SQRT_HOUR, G
from session.detect.rounding import lsb_of
from session.log.config import NO_SERIAL
from session.log.folder import sha256_of
from tinygc.closure.floor import (
    END_S,
    FLOOR_FREEDOM,
    GRID_RPS,
    READ_S,
    READ_SAMPLES,
    AllanSums,
    BiasInstability,
    curve_of,
    likelihood_of_instability,
)
from tinygc.closure.problem import AtRest, MeasuredNoise, NoiseComparison, Problem
from tinygc.inference.choose import ONE_SIDED, chi_square_above
from tinygc.noise.figures import FILE, AxisNoise, NoiseFigures, SensorNoise, Term, read_figures, unit_allan_variance

#: terms that make a bias drift at random; a ramp is none: a steady drift is taken out of the stills before their drift is estimated
WALKS = ("G", "B", "K")
#: units in which people read N, B and K, and their SI values
SHOWN = {
    "gyro": {"N": ("°/√h", DEG_PER_SQRT_HOUR), "B": ("°/h", DEG_PER_HOUR), "K": ("°/h/√h", DEG_PER_HOUR / 60)},
    "accel": {"N": ("m/s/√h", 1 / 60), "B": ("µg", 1e-6 * G), "K": ("µg/√h", 1e-6 * G / 60)},
}


def _shown(term: Term) -> bool:
    """Whether the figures give a size and its sigma."""
    return term.sigma is not None and term.value > 0


def relative_sigma(term: Term) -> float:
    """Sigma of ln of a term that the figures give."""
    return (term.sigma or 0.0) / term.value


def rms_of_axes(sensor: SensorNoise, name: str) -> tuple[float, float] | None:
    """Size of a term, rms over the axes that show it, SI, and its relative sigma; None where no axis does."""
    shown = [term for axis in sensor.axes if axis.is_described and _shown(term := axis.terms[name])]
    if not shown:
        return None
    return _rms(np.array([term.value**2 for term in shown]), np.array([relative_sigma(term) for term in shown]), len(shown))


def _rms(squares: np.ndarray, relative: np.ndarray, count: int) -> tuple[float, float]:
    """Root of the sum of squares (n,) over count, and its relative sigma, of the relative sigmas (n,) of their roots."""
    total = squares.sum()
    return float(np.sqrt(total / count)), float(np.sqrt(np.sum((squares / total * relative) ** 2)))


# The bias drift of a session, from figures at rest.
#
# A session's drift is modelled as flicker noise of one instability B (``closure.floor``).  A unit at rest may show a random walk of the
# rate or a Gauss-Markov process as well, or in its place.  Which of them matters depends on the session's length: over minutes, a random
# walk that rules over hours may be nothing.  Flicker noise has the same Allan variance, 2 ln 2 / pi B^2, at all averaging times.  So the
# instability of a session is the one whose Allan variance is the mean of the measured one over the session's time scales, in equal parts
# of their logarithm.  The Allan variance at one octave is about twice the power of the drift in that octave, so that both drifts have the
# same power between the shortest and the longest of these times.

#: s: the shortest of a session's time scales, a still's
SHORTEST_S = 1.0
#: averaging times at which the mean is taken, in equal steps of the logarithm: to 1e-3 of a random walk's share
TIMES = 400
#: an upper limit (95 %) of the drift, and no value: half of it is the median, and the limit is ``ONE_SIDED`` of these spreads above it
LIMIT_SPREAD = float(np.log(2) / ONE_SIDED)


def _session_instability(sensor: SensorNoise, session_s: float, file: str = FILE) -> BiasInstability | None:
    """Bias instability of a session of session_s s, from the gyroscope's figures at rest; None where they set none.

    The rms over the axes that show a drift; an axis whose data the terms do not describe counts for nothing.  Its relative sigma is that of
    the terms, each weighed by its share of the variance.  Where no axis shows one, it is half the upper limit.
    """
    tau_s = np.geomspace(SHORTEST_S, max(session_s, 2 * SHORTEST_S), TIMES)
    step = np.full(TIMES, 1.0)
    step[[0, -1]] = 0.5
    flicker = float(unit_allan_variance("B", np.ones(1))[0])

    def mean_of(name: str, correlation_s: float | None) -> float:
        """Mean Allan variance of a term of size 1 over these times, in that of flicker noise."""
        return float(step @ unit_allan_variance(name, tau_s, correlation_s or 1.0) / step.sum()) / flicker

    parts = [
        [(term.mean_square * mean_of(name, term.tau_s), relative_sigma(term)) for name in WALKS if _shown(term := axis.terms[name])]
        for axis in sensor.axes
        if axis.is_described
    ]
    if shown := [own for own in parts if own]:
        squares, relative = (np.array(column) for column in zip(*(part for own in shown for part in own), strict=True))
        rps, spread = _rms(squares, relative, len(shown))
        return BiasInstability(rps, f"measured at rest ({file})", rps * spread, rps * float(np.exp(ONE_SIDED * spread)))
    known = [axis for axis in range(3) if sensor.axes[axis].is_described]
    limits = [max(sensor.at_most(name)[axis] ** 2 * mean_of(name, None) for name in ("B", "K")) for axis in known]
    most_rps = float(np.sqrt(np.mean(limits))) if limits else np.inf
    if not np.isfinite(most_rps) or most_rps <= 0:
        return None
    return BiasInstability(most_rps / 2, f"half its limit at rest ({file})", most_rps / 2 * LIMIT_SPREAD, most_rps)


# The white noise of a session's stills, against the figures at rest.

#: readings of a log that show its steps
ROWS = 100_000


def _white_comparisons(problem: Problem, sensor: SensorNoise, rate_hz: float) -> tuple[NoiseComparison, ...]:
    """White noise of the gyroscope in a session's stills over that at rest, for each axis; empty where the stills are too few.

    rate_hz: data rate of the rest.  Both are Allan variances at one averaging time of the stills, so that the data rate of either does not
    matter, nor what the figures hold beyond white noise.  Their ratio follows F: the stills have the degrees of freedom of the Allan
    variance, the figures those of its sigma.  Rounding to the register's steps is white noise whose density depends on range and data rate;
    up to as much as the session's own steps would make in both, a difference is none.  Figures that do not describe an axis are compared
    with nothing.
    """
    if not all(axis.is_described for axis in sensor.axes):
        return ()
    from scipy.stats import f as law

    period_s = problem.logs[0].samples.period_s
    m = max(round(max(READ_S, 2 * max(axis.from_s for axis in sensor.axes)) / period_s), READ_SAMPLES)
    end = round(END_S / period_s)
    pieces = [
        (log.samples.gyro, still.start + end, still.stop - end)
        for log in problem.logs
        if abs(log.samples.period_s / period_s - 1) < 0.01
        for still in log.stills
        if still.problem is None and not still.bumps and still.stop - still.start > 2 * end + 2 * m
    ]
    if not pieces:
        return ()
    sums = [AllanSums.of(gyro[start:stop], (m,)) for gyro, start, stop in pieces]  # one still after the other: together they may be a day
    curve = curve_of(sums, period_s, max(stop - start for _, start, stop in pieces) * period_s)
    freedom, tau_s = float(curve.freedom[0]), float(curve.tau_s[0])
    if freedom < FLOOR_FREEDOM:
        return ()
    rounded = max(lsb_of(np.asarray(log.samples.gyro[:ROWS])) for log in problem.logs) ** 2 / 12 / tau_s
    found = []
    for own, axis in zip(curve.deviation[0] ** 2, sensor.axes, strict=True):
        expected, its = _allan_variance_of(axis, tau_s)
        if not 0 < expected < np.inf or own <= 0:
            return ()
        nearest = min(max(own, expected - rounded / rate_hz), expected + rounded * period_s)
        ratio = law(freedom, its)
        p = min(1.0, 3 * 2 * min(ratio.sf(own / nearest), ratio.cdf(own / nearest)))  # of three axes, two-sided
        low, high = np.sqrt(own / expected / ratio.ppf([0.975, 0.025]))
        found.append(NoiseComparison(float(np.sqrt(own / expected)), float(low), float(high), 1.0 if own == nearest else float(p)))
    return tuple(found)


def _allan_variance_of(axis: AxisNoise, tau_s: float) -> tuple[float, float]:
    """Allan variance of the figures at tau_s s, and its degrees of freedom, 2 A^2 / var(A)."""
    total = float(axis.allan_variance(np.array([tau_s]))[0])
    parts = {name: float(axis.allan_variance(np.array([tau_s]), name)[0]) for name, term in axis.terms.items() if _shown(term)}
    relative = [2 * part / total * relative_sigma(axis.terms[name]) for name, part in parts.items()]
    return total, 2 / max(sum(each**2 for each in relative), 1e-12)


# The bias drift of a session's stills, against the figures at rest.

#: ratios of drift that are tried, 1 in their middle, and steps of ln B: small against any sigma of a drift
RATIOS, STEPS = np.geomspace(0.02, 50.0, 801), 4000
#: the least relative sigma of a drift at rest; below it, it is exact for a session
LEAST_SPREAD = 0.01
#: chi-square of one parameter at 95 %
CHI_95 = 3.841


def _drift_comparison(known: BiasInstability, likelihood: np.ndarray | None, limit: bool = False) -> NoiseComparison | None:
    """Bias drift of a session over that at rest; None where the session does not show it.

    likelihood (B,): of the session's stills at each of ``GRID_RPS``.  The ratio is tested by the likelihood ratio, in which the drift at
    rest is another observation of ln B, with its own sigma.  Its interval holds the ratios whose chi-square is below 3.84.  limit: the rest
    gives an upper limit alone; ratios are to the limit, and only a larger drift contradicts it.
    """
    from scipy.interpolate import CubicSpline

    if likelihood is None or known.sigma_rps is None or not known.rps > 0:
        return None
    rps, spread = known.rps, max(known.sigma_rps / known.rps, LEAST_SPREAD)
    if limit:
        assert known.most_rps is not None  # an estimate has a limit
        rps, spread = known.most_rps, LEAST_SPREAD
    of_ln = np.log(GRID_RPS[1:])
    ln = np.linspace(of_ln[0], of_ln[-1], STEPS)
    away = 2 * (likelihood.max() - CubicSpline(of_ln, likelihood[1:])(ln))
    away -= away.min()
    off = np.array([np.min(away + ((ln - np.log(rps * ratio)) / spread) ** 2) for ratio in RATIOS])
    inside = RATIOS[off < max(CHI_95, np.nextafter(off.min(), np.inf))]  # the nearest, of a drift beyond them all
    best, same = float(np.exp(ln[int(np.argmin(away))])) / rps, float(off[len(RATIOS) // 2])
    if limit:
        return NoiseComparison(best, 0.0, float(inside[-1]), chi_square_above(same if best > 1 else 0.0, 1) / 2)
    return NoiseComparison(best, 0.0 if off[0] < CHI_95 else float(inside[0]), float(inside[-1]), chi_square_above(same, 1))


# What a command makes of a file.


def measured_noise(noise: Path | None = None) -> AtRest:
    """Noise figures for ``prepare``: those of ``noise``, else ``fit/noise.json`` of the session's folder, else none.

    Figures that were made of nothing but the session's own stills are none: they add nothing to the session.
    Raises FormatError for figures that cannot be read, or are of another serial number.
    """

    def of(problem: Problem) -> MeasuredNoise | None:
        session = problem.session
        # A folder that several units share has no figures of one of them.
        path = noise or (None if session.in_memory or is_special(session.folder) else session.folder / "fit" / FILE)
        if path is None or (noise is None and not path.is_file()):
            return None
        figures = read_figures(path)
        serial = session.config.sensor.serial
        if serial not in NO_SERIAL and figures.serial not in NO_SERIAL and figures.serial != serial:
            do = "give this unit's with --noise FILE" if noise is None else "give this unit's"
            raise FormatError(f"{path}: of the unit {figures.serial}, and the session is of {serial}; {do}, or measure it")
        own = {log.path.name for log in session.logs}
        if noise is None and figures.logs and own.issuperset(figures.logs):
            return None
        return compared(problem, figures, path)

    return of


def compared(problem: Problem, figures: NoiseFigures, path: Path) -> MeasuredNoise:
    """Add figures to a session.

    A drift that the session contradicts is no prior of it, and a mere limit is none where a smaller drift is given or typical.  Figures of
    the session's own stills and of hours of rest are taken as if the stills were not in them, whose share is small.
    """
    known = _session_instability(figures.gyro, float(problem.began_s[-1]), path.name)
    limit = not any(_shown(axis.terms[name]) for axis in figures.gyro.axes for name in WALKS)
    drift = None if known is None else _drift_comparison(known, likelihood_of_instability(problem.logs, problem.earths), limit)
    prior = None if drift is not None and drift.contradicted else known
    if limit and prior is not None and prior.most_rps is not None:
        other = problem.instability
        prior = None if 0 < other.rps <= prior.most_rps and not other.of_unit else prior
    return MeasuredNoise(path, sha256_of(path), prior, _white_comparisons(problem, figures.gyro, figures.rate_hz), drift)
