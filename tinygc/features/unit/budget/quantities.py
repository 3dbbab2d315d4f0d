"""The budgets of a fit: its twelve parameters, the errors of both sensors in the field's words, the attitude after a motion; and what a
calibration is used for.  Of each quantity: the sources of its variance, what is not in the sum, and the expanded uncertainty.

    u^2 = sum u_i^2          c_i = u_i / size of the source          U = k u,  k = t_p(nu_eff)

(GUM, JCGM 100:2008, 5.1 and annex G.4).  The variances are those of the fit's covariance, source by source, and add up to it in their order
to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from session.base.numeric import rms_of
from session.base.records import in_unit
from session.base.texts import printable
from session.base.units import DEG, DEG_PER_HOUR, MG, G
from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.detect.rounding import lsb_of
from session.log.folder import read_session
from tinygc.closure.earth import unseen_covariance
from tinygc.closure.floor import ACCEL_NOISE, DIALS, GYRO_NOISE, SINGLE_SEGMENTS, STAMPS, STOPS
from tinygc.closure.motion import Motion, at_rest, motion_of
from tinygc.closure.problem import GRAVITY
from tinygc.closure.uncertainty import BIAS_DRIFT, EARTH
from tinygc.estimation.accelerometer import UNITS
from tinygc.estimation.spread import USUAL_PER_K, ZERO, drift_between
from tinygc.estimation.stated_noise import CALIBRATION, CLOCK, COMPONENTS, GRAVITY_LENGTH, MISFIT, ROUNDING, kind_of, stated_response
from tinygc.features.unit.options import BudgetOptions
from tinygc.fitting.results import FitResult
from tinygc.inference.solve import COVERAGE, Kind, Source, coverage_factor, effective_freedom, freedom_of, root
from tinygc.library.logs import read_log
from tinygc.models.linear import BIAS, NAMES, PARAMETERS, WORDS, field_jacobian
from tinygc.noise.components import WANDER
from tinygc.noise.whitening import PRECALIBRATION_MPS2
from tinygc.reporting.fit_text import sensor_errors

#: sensor errors of the overview, and of a report's bars
SHOWN = ("scale factor error", "misalignment", "bias")
MISSING_EFFECT, STILL_ALLOWED = "one effect missing from the model", "the largest that this recording allows (fit: systematic)"
#: what a usual spread between switch-ons asks for
GIVE_SPREAD = "give --history"
#: what a clock moves by less than this share of its own error does not depend on it
LEAST_OF_CLOCK = 0.01


# One budget.


@dataclass(frozen=True)
class Row:
    """source: its name; kind; freedom: degrees of freedom; variance in SI; size of the source in ``size_unit``, None where it has no
    single one."""

    source: str
    kind: Kind
    freedom: float
    variance: float
    size: float | None = None
    size_unit: str = ""

    @property
    def u(self) -> float:
        """Standard uncertainty, SI; negative where the source takes variance away, as a mixture with a prior may."""
        return float(np.copysign(np.sqrt(abs(self.variance)), self.variance))


@dataclass(frozen=True)
class Excluded:
    """What is known to move the quantity and is not in the sum: what; u in SI, None where it is not known; why, or what to give."""

    what: str
    u: float | None
    why: str

    def to_json(self, si: float) -> dict:
        """One entry of ``not_in_the_sum``, in a unit of this SI value."""
        return {"what": self.what, **in_unit(si, u=self.u), "why": self.why}


@dataclass(frozen=True)
class Budget:
    """The budget of one quantity: name; unit and its SI value; value in SI, None of an error about zero; rows; excluded."""

    name: str
    unit: str
    si: float
    value: float | None
    rows: tuple[Row, ...]
    excluded: tuple[Excluded, ...] = ()

    @property
    def shown_unit(self) -> tuple[str, float]:
        """The unit that people read, and its SI value: ppm of a number without one."""
        return ("ppm", 1e-6) if self.unit == "1" else (self.unit, self.si)

    @property
    def variance(self) -> float:
        """In SI: the sum of the rows, in their order."""
        found = self.rows[0].variance
        for row in self.rows[1:]:
            found += row.variance
        return found

    @property
    def u(self) -> float:
        """Combined standard uncertainty, SI."""
        return float(np.sqrt(self.variance))

    @property
    def freedom(self) -> float:
        """Effective degrees of freedom (Welch–Satterthwaite)."""
        return effective_freedom([row.variance for row in self.rows], [row.freedom for row in self.rows])

    @property
    def k(self) -> float:
        """Coverage factor of 95 %."""
        return coverage_factor(self.freedom, COVERAGE)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k u, SI."""
        return self.k * self.u

    @property
    def largest(self) -> list[Row]:
        """The rows by their share, the largest first."""
        return sorted(self.rows, key=lambda row: -row.variance)

    def share(self, row: Row) -> float:
        """Share of a row in the variance."""
        return row.variance / self.variance

    def to_json(self) -> dict:
        """One entry of ``budgets`` of ``tinygc-budget/1``; variances in the square of SI."""
        return {
            "name": self.name,
            "unit": self.unit,
            "unit_si": self.si,
            **in_unit(self.si, value=self.value, u=self.u),
            "degrees_of_freedom": self.freedom,
            "k": self.k,
            "expanded_uncertainty": self.expanded / self.si,
            "variance_si": self.variance,
            "sources": [
                {
                    "source": row.source,
                    "type": row.kind,
                    "degrees_of_freedom": row.freedom,
                    "size": row.size,
                    "size_unit": row.size_unit,
                    "sensitivity": None if not row.size else abs(row.u) / self.si / row.size,
                    "u": row.u / self.si,
                    "variance_si": row.variance,
                    "share": self.share(row),
                }
                for row in self.rows
            ],
            "not_in_the_sum": [each.to_json(self.si) for each in self.excluded],
        }


def budget_of(
    name: str,
    unit: str,
    si: float,
    value: float | None,
    sources: Iterable[Source],
    slopes: np.ndarray,
    sizes: dict[str, tuple[float, str]],
    excluded: Sequence[Excluded],
) -> Budget:
    """The budget of a quantity whose variance is the sum of those with these derivatives (K, P) by what the sources are of."""
    rows = (
        Row(source.name, source.kind, source.freedom, float(source.variance(slopes).sum()), *sizes.get(source.name, (None, "")))
        for source in sources
    )
    return Budget(name, unit, si, value, tuple(rows), tuple(excluded))


# Those of a fit.


def parameter_budgets(result: FitResult) -> list[Budget]:
    """Of the twelve parameters of omega = E m + B; their variances are the diagonal of the fit's covariance, bit for bit."""
    vector, sizes = result.linear.linear.vector, _source_sizes(result)
    found = []
    for i, name in enumerate(NAMES):
        unit, si = ("dps", DEG) if name in NAMES[BIAS] else ("1", 1.0)
        slope = np.eye(PARAMETERS)[i]
        found.append(budget_of(name, unit, si, float(vector[i]), result.sources, slope[None], sizes, _excluded_of_parameter(result, slope)))
    return found


def sensor_error_budgets(result: FitResult) -> list[Budget]:
    """Of the sensor errors in the terms and signs of ``fit``; those that the session does not observe are left out."""
    vector, sizes = result.linear.linear.vector, _source_sizes(result)
    units = {word: si for word, _, _, si in WORDS}
    found = []
    for quantity, slope in zip(sensor_errors(result), field_jacobian(vector), strict=True):
        if quantity.observed:
            name, si = quantity.name, units[quantity.word]
            excluded = _excluded_of_parameter(result, slope)
            found.append(budget_of(name, quantity.unit, si, quantity.value * si, result.sources, slope[None], sizes, excluded))
    return found


def accelerometer_budgets(result: FitResult) -> list[Budget]:
    """Of the accelerometer's errors in the terms and signs of ``fit``, as far as the session estimates and observes them."""
    found, sizes, budgets = result.accelerometer, _source_sizes(result), []
    for word, unit, values, _, names in found.errors() if found.sources else ():
        for value, name in zip(values, names, strict=True):
            if name in found.unobserved:
                continue
            at, si = ACCELEROMETER_NAMES.index(name), UNITS[unit]
            other = float(np.sqrt(2) * found.between.sigma[at])
            excluded = [Excluded("another switch-on", other, f"{found.between.source}; counts in any other session")] if other else []
            called = f"accelerometer {word} {name.split()[-1]}"
            budgets.append(budget_of(called, unit, si, value * si, found.sources, found.slope[at][None], sizes, excluded))
    return budgets


def use_budgets(result: FitResult, use: BudgetOptions) -> tuple[Motion, list[Budget]]:
    """Of the attitude after a motion, about each axis of the start, and of the total angle.  Raises CalibrationError for its log."""
    motion = motion_in(use, result)
    sources, more, assumed = sources_in_use(result, use, motion)
    sizes, slope = _source_sizes(result) | more, motion.slope(result.linear.linear)
    found = []
    for name, of in zip((*ATTITUDE, TOTAL), (*np.eye(3)[:, None], np.eye(3)), strict=True):
        found.append(budget_of(name, "°", DEG, None, sources, of, sizes, _excluded_of_use(result, use, of @ slope, assumed)))
    return motion, found


# What moves a quantity and is not in its sum.


def _excluded_of_parameter(result: FitResult, slope: np.ndarray) -> list[Excluded]:
    """Of a quantity with this derivative (12,) by the parameters: one effect missing from the model, another switch-on, an Earth's rate
    that is left out, a clock that is not known."""
    found = list(_clock(result, slope))
    if result.allowed is not None:
        found.append(Excluded(MISSING_EFFECT, float(result.allowed.of(slope[None])[0]), STILL_ALLOWED))
    else:
        found.append(Excluded(MISSING_EFFECT, None, "this recording's noise is not estimated"))
    if np.abs(slope[BIAS]).any():
        spread = result.spread.at(ZERO)
        if spread.is_usual:
            found.append(Excluded(SWITCH_ON, None, GIVE_SPREAD))
        else:
            u = float(np.sqrt(2 * np.sum((slope[BIAS] * spread.sigma) ** 2)))
            found.append(Excluded(SWITCH_ON, u, f"{spread.source}; counts in any other session"))
    if (left := earth_left_out(result)) is not None:
        found.append(Excluded("the Earth's rate", float(np.sqrt(slope @ left @ slope)), "give site.latitude_deg"))
    return found


def _clock(result: FitResult, slope: np.ndarray) -> Iterator[Excluded]:
    """Of quantities with this derivative (..., 12): a clock that is not known, where it moves them, as it scales E and B together."""
    vector = result.linear.linear.vector
    if not result.session.clock_known and np.abs(slope @ vector).max() > LEAST_OF_CLOCK * np.linalg.norm(vector):
        yield Excluded(CLOCK, None, "give sensor.clock_sigma_ppm")


def _excluded_of_use(result: FitResult, use: BudgetOptions, slope: np.ndarray, assumed: tuple[str, ...]) -> list[Excluded]:
    found = list(_clock(result, slope))
    if result.allowed is not None:
        found.append(Excluded(MISSING_EFFECT, float(np.sqrt(np.sum(result.allowed.of(slope) ** 2))), STILL_ALLOWED))
    if use.warmer_k is None:
        found.append(Excluded(TEMPERATURE, None, "give --warmer"))
    if use.elapsed_s is not None and not result.problem.instability.rps:
        found.append(Excluded(DRIFT_SINCE, None, "give sensor.gyro_bias_instability_dph"))
    for name in assumed:
        give = GIVE_SPREAD if name == USUAL_SWITCH_ON else "U has a usual size"
        found.append(Excluded(f"this unit's own {name.removesuffix(AS_USUAL)}", None, give))
    return found


def earth_left_out(result: FitResult) -> np.ndarray | None:
    """(12, 12) that the Earth's rate may have moved the parameters, where it is left in the rates; None where it is taken off."""
    problem = result.problem
    if problem.earth.source != "none" or result.noise is None:
        return None
    rows = stated_response(problem, result.linear.linear)
    columns = rows @ result.noise.twin.earth_columns().stacked()
    return columns @ unseen_covariance(problem.earth, problem.session.config.site.latitude_deg) @ columns.T


# The size of each source, in a usual unit.


def _source_sizes(result: FitResult) -> dict[str, tuple[float, str]]:
    """Name of a source -> its size and unit; sources without a single size are missing."""
    problem, config, noise = result.problem, result.session.config, result.problem.noise
    found = {
        GYRO_NOISE: (rms_of(noise.gyro) / DEG, "dps/√Hz"),
        ACCEL_NOISE: (rms_of(noise.accel) / MG, "mg/√Hz"),
        DIALS: (config.protocol.dial_sigma_deg, "°"),
        BIAS_DRIFT: (problem.instability.rps / DEG_PER_HOUR, "°/h"),
        MISFIT: (float(np.sqrt(max(result.widened - 1, 0.0))), "sigmas of the noise"),
    }
    if (reference := result.session.reference) is not None:
        found[reference.title] = (reference.sigma_deg, "°")
    if problem.batch.turns is not None:
        found[STOPS] = (float(np.sqrt(np.nanmean(problem.batch.turns.sigma_rad**2))) / DEG, "°")
    if (late := problem.floor.references.get(STAMPS)) is not None:
        found[STAMPS] = (float(np.sqrt(np.mean(late.own[:, 0, 0] + late.own[:, 1, 1]))) / DEG, "°")
    if problem.widened:
        found[SINGLE_SEGMENTS] = (float(np.sqrt(np.mean([each.sigma_rad**2 for each in problem.widened]))) / DEG, "°")
    if result.noise is not None:
        for s, component in zip(result.noise.noise.s, result.noise.noise.components, strict=True):
            found[COMPONENTS[component.name]] = (float(s / component.si), "°" if component.unit == "deg" else component.unit)
    if (joint := problem.joint) is None:
        found[CALIBRATION] = (PRECALIBRATION_MPS2 / MG, "mg")
    else:
        if joint.mode == "prior":
            found[CALIBRATION] = (float(joint.prior[-1]) / MG, "mg")
        found[GRAVITY_LENGTH] = (float(joint.system.prior[GRAVITY]) / G * 1e6, "ppm")
    if problem.earth.source in ("estimated", "unknown"):
        unseen = unseen_covariance(problem.earth, config.site.latitude_deg)
        found[EARTH] = (float(np.sqrt(np.trace(unseen))) / DEG_PER_HOUR, "°/h")
    if (clock := result.session.clock) is not None:
        found[CLOCK] = (1e6 * clock.sigma, "ppm") if result.nominal_rate is None else (100 * clock.sigma, "%")
    rests = [np.asarray(log.samples.gyro[s.start : s.stop]) for log in problem.logs for s in log.stills[:1]]
    if rests:
        found[ROUNDING] = (lsb_of(np.concatenate(rests)) / DEG, "dps a step")
    return found


def named(budgets: Sequence[Budget], name: str) -> Budget | None:
    """The budget with this name, written with blanks or underscores; None where there is none."""
    wanted = printable(name).replace("_", " ").casefold().removesuffix(" - 1")
    return next((each for each in budgets if each.name.replace("_", " ").casefold().removesuffix(" - 1") == wanted), None)


# The attitude after a motion, with the errors of the calibration and those of the use itself.
#
#     phi = A (theta - truth)  +  white noise and drift of the bias during the motion
#           + A_B (bias of another switch-on, temperature)                    A (3, 12): slope of ``closure.motion``
#
# Within one switch-on the drift in the use and in the session are partly the same: its row is the variance of their difference.  With S and
# U their parts of the attitude's covariance, S' and U' the symmetric roots, and rho the correlation of their means (``drift_between``), it
# is S + U - rho (S' U' + U' S').  Axes are those of the body at the start.  The total angle's variance is the sum of the three.

#: names of the sources of the use itself
_NOISE_OF_USE, _DRIFT_OF_USE = f"{GYRO_NOISE}, in use", f"{BIAS_DRIFT}, in use"
SWITCH_ON, TEMPERATURE = "bias of another switch-on", "temperature of the use"
#: the same by the spread that is usual of MEMS gyroscopes, where that of the unit is not known
AS_USUAL = ", as usual"
USUAL_SWITCH_ON = f"{SWITCH_ON}{AS_USUAL}"
#: the drift in use less that in the session, of one switch-on
DRIFT_SINCE = f"{BIAS_DRIFT} since the session"
#: word for a sensor that lies still
REST = "rest"
#: names of the attitude's error about single axes; the total angle of it
ATTITUDE = ("attitude x", "attitude y", "attitude z")
TOTAL = "attitude total"


def motion_in(use: BudgetOptions, result: FitResult) -> Motion:
    """The motion.  Raises CalibrationError for a log that cannot be read, or is too short."""
    if use.motion is None:
        return motion_of(result.session.logs, use.seconds)
    if str(use.motion) == REST:
        return at_rest(result.linear.linear, use.seconds)
    path, sensor = use.motion, result.session.config.sensor
    if path.is_dir():
        return motion_of(read_session(path).logs, use.seconds)
    answers: dict[str, Any] = {"gyro_fs_dps": sensor.gyro_fs_dps, "accel_fs_g": sensor.accel_fs_g, "sensor": sensor.model}
    return motion_of(read_log(path, **answers).session().logs, use.seconds)


class SourcesInUse(NamedTuple):
    """Sources (3, 3) rad^2 of the attitude at a motion's end; sizes of those that only the use has, in a unit; assumed: names of those
    whose size is not this unit's own."""

    sources: list[Source]
    sizes: dict[str, tuple[float, str]]
    assumed: tuple[str, ...]


def sources_in_use(result: FitResult, use: BudgetOptions, motion: Motion) -> SourcesInUse:
    """Collect what the attitude at a motion's end is uncertain by."""
    model = result.linear.linear
    slope = motion.slope(model)
    found = [source.through(slope) for source in result.sources]
    density, problem = result.problem.noise.angle_random_walk, result.problem
    found.append(Source(_NOISE_OF_USE, *kind_of(GYRO_NOISE, problem), motion.noise_covariance(model, density, 0.0)))
    rps, drift = _drift(result)
    sizes = {_NOISE_OF_USE: (rms_of(problem.noise.gyro) / DEG, "dps/√Hz")}
    sizes |= dict.fromkeys((_DRIFT_OF_USE, DRIFT_SINCE), (rps / DEG_PER_HOUR, "°/h"))
    in_use = motion.noise_covariance(model, np.zeros(3), rps)
    at = next((i for i, source in enumerate(found) if source.name == BIAS_DRIFT), None)
    if use.elapsed_s is None or at is None:
        found.append(replace(drift, name=_DRIFT_OF_USE, covariance=in_use))
    else:
        middle_s = problem.began_s[-1] + use.elapsed_s + motion.duration_s / 2
        between = drift_between(problem.middle_s, problem.batch.duration_s, middle_s, motion.duration_s, rps)
        shared = between.correlation * root(found[at].covariance) @ root(in_use)
        found[at] = replace(drift, name=DRIFT_SINCE, covariance=found[at].covariance + in_use - shared - shared.T)
    spread, assumed = result.spread.at(ZERO), list[str]()
    if use.elapsed_s is None:
        name = USUAL_SWITCH_ON if spread.is_usual else SWITCH_ON
        own = Source(name, "B", np.inf, spread.two_draws)
        if np.isfinite(spread.freedom).all():  # as estimated: its freedom is in k
            own = Source(name, "A", float(spread.freedom.min()), np.diag(2 * spread.scatter**2))
        found.append(own.through(slope[:, BIAS]))
        sizes[name] = (np.sqrt(2) * rms_of(spread.sigma) / DEG, "dps")
        assumed += [USUAL_SWITCH_ON] if spread.is_usual else []
    if use.warmer_k:
        rps = USUAL_PER_K * abs(use.warmer_k)
        found.append(Source(TEMPERATURE, "B", np.inf, rps**2 * np.eye(3)).through(slope[:, BIAS]))
        sizes[TEMPERATURE] = (rps / DEG, "dps")
        assumed.append(TEMPERATURE)
    return SourcesInUse(found, sizes, tuple(assumed))


def _drift(result: FitResult) -> tuple[float, Source]:
    """Bias instability, rad/s: as estimated from the recording, else as known beforehand; and a source with its kind and freedom."""
    nothing = np.zeros((3, 3))
    if result.noise is not None:
        noise = result.noise.noise
        for s, sigma, component in zip(noise.s, noise.sigma, noise.components, strict=True):
            if component.name == WANDER and s > 0:
                return float(s), Source(COMPONENTS[WANDER], "A" if component.prior is None else "B", freedom_of(s, sigma), nothing)
    known = result.problem.instability
    return known.rps, Source(BIAS_DRIFT, *kind_of(BIAS_DRIFT, result.problem), nothing)
