"""The decision rules: whether a measured value with its uncertainty meets its limits, and with which risk; the one place that decides.

    p = F((upper - y) / u) - F((lower - y) / u)     probability of conformity, F: Student's t of u's degrees of freedom, or normal
    1 - p                                           risk of a wrong PASS           p    risk of a wrong FAIL

(JCGM 106:2012, 7.2, with no prior knowledge of the item.)  Simple acceptance passes a value within its limits: at one limit, half
of such answers are wrong; between two that are close together against U, more.  A guard band w = r U draws the limits in for a PASS, and
out for a FAIL (ISO/IEC 17025:2017, 7.8.6; ILAC-G8:09, 4.2); in between nothing is decided.  With a largest risk in place of r, PASS and
FAIL are wrong in at most that share of the cases.

The RMSE of a closure run is the length of three errors.  Near its floor it is neither normal nor symmetric, so that its p is that of three
normal errors inside a sphere, and its guard band ends where p is F(r k); below its limit it does not fail.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import fixed, probability, significant
from session.base.units import DEG
from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.log.requirements import ATTITUDE, CLOSURE, CLOSURE_RUN, KINDS, SIMPLE, Requirements, Rule
from tinygc.closure.motion import at_rest
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.bias import tilt_rms
from tinygc.estimation.sources import Source, coverage_factor, effective_freedom, total
from tinygc.models.linear import NAMES, PARAMETERS, LinearModel, field_jacobian, field_quantities, field_vector

Answer = Literal["pass", "fail", "not decided"]
#: var(mean) S / mean^2 of squared tilts: 1 for two normal angles alike; where the stills that neighbours share err alone, their angles
#: correlate by -1/2 and their squares by 1/4, with two neighbours each
SHARED = 1.5
#: between thousands on a page; a terminal shows it as an escape
THIN = "\u202f"


def quantile(share: float, freedom: float = np.inf) -> float:
    """Value that Student's t (normal: infinite freedom) stays below in this share of the cases."""
    from scipy.special import ndtri, stdtrit  # late: most fits have no requirement

    return float(ndtri(share) if not np.isfinite(freedom) else stdtrit(freedom, share))


def conforms_probability(value: float, sigma: float, limits: tuple[float, float], freedom: float = np.inf) -> float:
    """Probability that the true value lies within the limits, given the measured one."""
    lower, upper = limits
    if not sigma > 0:
        return float(lower <= value <= upper)
    from scipy.special import ndtr, stdtr

    ends = np.array([upper - value, lower - value]) / sigma
    below = ndtr(ends) if not np.isfinite(freedom) else stdtr(freedom, ends)
    return float(np.clip(below[0] - below[1], 0.0, 1.0))


#: sigmas of a normal error beyond which it is neglected; nodes of the quadrature within; sigmas of a guard band beyond which it is linear
_FAR, _NODES, _BAND = 9.0, 96, 4.0


def rms_below(limit: float, errors: tuple[float, ...], sigmas: tuple[float, ...]) -> float:
    """Probability that the root mean square of three normal errors, about these values with these sigmas, is at most a limit.

    One axis in closed form, the others by Gauss–Legendre quadrature over the sphere; of equal sigmas it is a non-central chi-square.
    """
    if not np.isfinite(limit) or limit <= 0:
        return float(limit > 0)
    from scipy.special import ndtr

    radius, (x, y, z) = np.sqrt(3) * limit, errors
    sx, sy, sz = np.maximum(sigmas, 1e-9 * max(sigmas))
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)

    def within(half: np.ndarray, middle: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
        """Places across -half to half, as far as the error comes, and their weights with its density."""
        low, high = np.maximum(-half, middle - _FAR * sigma), np.minimum(half, middle + _FAR * sigma)
        width = np.maximum(high - low, 0.0)[..., None] / 2
        places = low[..., None] + width * (1 + nodes)
        return places, weights * width * np.exp(-(((places - middle) / sigma) ** 2) / 2) / (np.sqrt(2 * np.pi) * sigma)

    across, of_z = within(np.asarray(radius), z, sz)
    half = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    along, of_y = within(half, y, sy)
    chord = np.sqrt(np.maximum(half[:, None] ** 2 - along**2, 0.0))
    inside = ndtr((chord - x) / sx) - ndtr((-chord - x) / sx)
    return float(np.clip(of_z @ np.sum(of_y * inside, axis=1), 0.0, 1.0))


def simply_accepted(value: float, limits: tuple[float, float]) -> bool:
    """Whether a value lies within its limits; not, where it is no number."""
    return bool(limits[0] <= value <= limits[1])


# A measured value, its limits, the rule: what is decided, and the risk.


@dataclass(frozen=True)
class Measured:
    """A measured value.

    key: of ``session.log.requirements``; words; unit; value and sigma, its standard uncertainty, in that unit; freedom: degrees of freedom
    of sigma; observed: whether the session determines it; relative: whether it is decided on the scale of logarithms, as a size is whose
    scatter grows with it (sigma then is value times that of the logarithm); errors: three errors and the sigma of each, whose root mean
    square the value is.
    """

    key: str
    words: str
    unit: str
    value: float
    sigma: float
    freedom: float = np.inf
    observed: bool = True
    relative: bool = False
    errors: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    @property
    def factor(self) -> float:
        """Coverage factor k of 95 %."""
        return coverage_factor(self.freedom)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k sigma."""
        return self.factor * self.sigma


@dataclass(frozen=True)
class Conformity:
    """Whether a measured value meets its limits (lower, upper) by a rule; reference: where the limits are from."""

    measured: Measured
    limits: tuple[float, float]
    rule: Rule
    reference: str = ""

    @cached_property
    def _scaled(self) -> tuple[float, float, tuple[float, float]]:
        """Value, sigma and limits on the scale on which it is decided."""
        m = self.measured
        if not m.relative:
            return m.value, m.sigma, self.limits
        lower, upper = (float(np.log(limit)) if limit > 0 else -np.inf for limit in self.limits)
        return float(np.log(m.value)), m.sigma / m.value, (lower, upper)

    @property
    def _width(self) -> float:
        """Of the guard band, in sigmas: 0 in simple acceptance; with a largest risk, that of one limit far from the other."""
        if self.rule.kind == SIMPLE:
            return 0.0
        return self.rule.guard * self.measured.factor if self.rule.risk is None else quantile(1 - self.rule.risk, self.measured.freedom)

    def _moved(self, inwards: float) -> tuple[float, float]:
        """The limits, moved towards each other by so many sigmas on the scale of the decision."""
        if inwards == 0:
            return self.limits
        if self.measured.errors is not None:
            near = float(np.clip(inwards, -_BAND, _BAND))
            lower, upper = self._at(self.limits[0], -near), self._at(self.limits[1], near)
            further = (inwards - near) * self.measured.sigma
            return lower + further, upper - further
        (lower, upper), by = self._scaled[2], inwards * self._scaled[1]
        found = (lower + by, upper - by)
        return (float(np.exp(found[0])), float(np.exp(found[1]))) if self.measured.relative else found

    def _at(self, limit: float, sigmas_below: float) -> float:
        """RMSE, of errors in the direction of the measured ones, that is below a limit with the probability F(sigmas_below); just below 0
        where errors of 0 are so with less."""
        if not np.isfinite(limit):
            return limit
        from scipy.optimize import brentq
        from scipy.special import ndtr

        assert self.measured.errors is not None
        errors, sigmas = self.measured.errors
        size = float(np.linalg.norm(errors))
        unit = np.array(errors) / size if size > 0 else np.full(3, 1 / np.sqrt(3))

        def surplus(value: float) -> float:
            return rms_below(limit, tuple(value * np.sqrt(3) * unit), sigmas) - float(ndtr(sigmas_below))

        far = max(limit, 0.0) + _FAR * float(max(sigmas))
        return float(brentq(surplus, 0.0, far, xtol=1e-9 * far)) if surplus(0.0) > 0 else float(np.nextafter(0, -1))

    @property
    def acceptance(self) -> tuple[float, float]:
        """Least and largest value that passes, where a guard band decides."""
        return self._moved(self._width)

    @property
    def band(self) -> float:
        """Width w of the guard band within a limit, in the unit of the value: the upper one where there are two."""
        (lower, upper), (least, most) = self.limits, self.acceptance
        return upper - most if np.isfinite(upper) else least - lower

    @cached_property
    def probability(self) -> float:
        """Of conformity, given the measured value."""
        if self.measured.errors is not None:
            most, least = (rms_below(limit, *self.measured.errors) for limit in reversed(self.limits))
            return most - least
        value, sigma, limits = self._scaled
        return conforms_probability(value, sigma, limits, self.measured.freedom)

    @property
    def ratio(self) -> float | None:
        """Test uncertainty ratio (upper - lower) / 2 U; None of one limit alone, or without an uncertainty."""
        width, expanded = self.limits[1] - self.limits[0], self.measured.expanded
        return width / (2 * expanded) if np.isfinite(width) and expanded > 0 else None

    @cached_property
    def answer(self) -> Answer:
        """PASS, FAIL or NOT DECIDED; the last for what the session does not determine."""
        value = self.measured.value
        if not self.measured.observed or not np.isfinite(value):
            return "not decided"
        if self.rule.kind == SIMPLE:
            if self.rule.least_ratio is not None and (self.ratio is None or self.ratio < self.rule.least_ratio):
                return "not decided"
            return "pass" if simply_accepted(value, self.limits) else "fail"
        if not np.isfinite(self.measured.sigma):
            return "not decided"
        if self.rule.risk is not None:
            passes, fails = 1 - self.probability <= self.rule.risk, self.probability <= self.rule.risk
        else:
            passes, fails = simply_accepted(value, self.acceptance), not simply_accepted(value, self._moved(-self._width))
        if self.measured.errors is not None and simply_accepted(value, self.limits):
            fails = False  # noise alone makes an RMSE; what is below its limit does not fail because the noise is above it
        return "pass" if passes else "fail" if fails else "not decided"

    @property
    def risk(self) -> float | None:
        """Probability that a PASS, or a FAIL, is wrong; None where nothing is decided or the uncertainty is not known."""
        if self.answer == "not decided" or not np.isfinite(self.measured.sigma):
            return None
        return 1 - self.probability if self.answer == "pass" else self.probability

    @property
    def limit_words(self) -> str:
        """The limits, in the unit of the value."""
        lower, upper = self.limits
        unit = self.measured.unit if self.measured.unit == "°" else f" {self.measured.unit}"
        if not np.isfinite(lower):
            return f"at most {_significant(upper)}{unit}"
        if not np.isfinite(upper):
            return f"at least {_significant(lower)}{unit}"
        return f"{_significant(lower)} to {_significant(upper)}{unit}"

    @property
    def value_words(self) -> str:
        """The value with U, to two digits of U."""
        m = self.measured
        unit = m.unit if m.unit == "°" else f" {m.unit}"
        if not m.observed or not np.isfinite(m.value):
            return "not observed"
        if not (np.isfinite(m.sigma) and m.sigma > 0):
            return f"{_significant(m.value)}{unit}"
        decimals = 1 - int(np.floor(np.log10(m.expanded) + 1e-12))
        value, expanded = (fixed(each, decimals).replace(THIN, "") for each in (m.value, m.expanded))
        return f"{value}{unit} ± {expanded}{unit} (k = {m.factor:.2f})"

    @property
    def risk_words(self) -> str:
        """What the answer risks; of an undecided value, what either answer would."""
        if self.measured.key == ATTITUDE:
            return "no risk is stated, since the value is an uncertainty itself"
        if not np.isfinite(self.measured.sigma) or not self.measured.observed:
            return "its uncertainty is not known, and so is the risk"
        wrong = {"pass": 1 - self.probability, "fail": self.probability}
        if self.risk is not None:
            return f"risk that this {self.answer.upper()} is wrong: {share_words(self.risk)}"
        return f"a PASS would be wrong with {probability(wrong['pass'])}, a FAIL with {probability(wrong['fail'])}"

    @property
    def words(self) -> str:
        """The whole statement in one line."""
        return f"{self.measured.words}: {self.value_words}, required {self.limit_words}: {self.answer.upper()}; {self.risk_words}"

    def to_json(self) -> dict:
        """Return an entry of ``conformity`` of ``tinygc-fit/2``; null for what is not known, or has no limit."""
        m = self.measured
        numbers = {
            "value": m.value if m.observed else None,
            "standard_uncertainty": m.sigma,
            "degrees_of_freedom": m.freedom,
            "coverage_factor": m.factor,
            "expanded_uncertainty": m.expanded,
            "lower": self.limits[0],
            "upper": self.limits[1],
            "guard_band": self.band,
            "test_uncertainty_ratio": self.ratio,
            "conformity_probability": self.probability if np.isfinite(m.sigma) and m.observed else None,
            "risk": self.risk,
        }
        known = {key: value if value is not None and np.isfinite(value) else None for key, value in numbers.items()}
        return {"quantity": m.key, "name": m.words, "unit": m.unit, "rule": self.rule.kind, "answer": self.answer} | known


def _significant(value: float) -> str:
    return significant(value, 3).replace(THIN, "")


def share_words(share: float) -> str:
    """A probability as a share in percent, or its bound."""
    return "below 0.01 %" if share < 1e-4 else f"{significant(100 * share, 2)} %"


def rule_words(rule: Rule) -> str:
    """The rule in one sentence."""
    if rule.kind == SIMPLE:
        condition = f", with a test uncertainty ratio of at least {rule.least_ratio:g}" if rule.least_ratio is not None else ""
        return f"Simple acceptance{condition}: a measured value within its limits passes, however large its uncertainty."
    if rule.risk is not None:
        most = share_words(rule.risk)
        return f"Guard bands by risk: PASS and FAIL are wrong with a probability of at most {most}; in between nothing is decided."
    return (
        f"Guard bands of w = {rule.guard:g} U at each limit: PASS within the limits by at least w, FAIL beyond them by more than w; in "
        "between nothing is decided."
    )


# Measured values of a calibration, with their standard uncertainties.


def closure_measured(angles: np.ndarray, numbers: Sequence[int]) -> Measured:
    """Root mean square tilt of error angles (S, 2 or 3) rad of segments by their numbers, degrees.

    The squared tilts scatter about their mean, each correlated with its neighbour's, with which it shares a still:
    var(mean) = (sum c_i^2 + 2 sum c_i c_i+1) / S (S - 1), u = var^(1/2) / 2 rms.  A few squares that happen to be alike show no scatter:
    var is at least ``SHARED`` / S of the mean's square.  How often such a U holds is in docs/measured/decision-rules.md.
    """
    squares, count = np.sum(angles[:, :2] ** 2, axis=1), len(angles)
    rms = tilt_rms(angles)
    if count < 2 or not rms > 0:
        return Measured(CLOSURE, "closure of held-out segments, rms of tilt", "°", rms / DEG, float("nan"))
    c = squares / rms**2 - 1
    neighbours = np.diff(np.asarray(numbers)) == 1
    shared = float(np.sum((c[:-1] * c[1:])[neighbours]))
    variance = max((float(c @ c) + 2 * max(shared, 0.0)) / (count * (count - 1)), SHARED / count)
    sigma = np.sqrt(variance) / 2 * rms / DEG
    return Measured(CLOSURE, "closure of held-out segments, rms of tilt", "°", rms / DEG, sigma, count - 1, relative=True)


def run_measured(file: str, error: np.ndarray, floor: np.ndarray | None) -> Measured:
    """RMSE of a closure run of errors (3,) rad, degrees; floor (3,) rad: one sigma of each from noise alone, None where not known.

    sigma is the root mean square of what the true RMSE departs from it: near the floor it holds that noise adds to the size.
    """
    size, words = rms_of(error) / DEG, f"closure run {file}, RMSE"
    if floor is None or not np.isfinite(size):
        return Measured(CLOSURE_RUN, words, "°", size, float("nan"))
    nodes, weights = np.polynomial.hermite_e.hermegauss(16)
    true = np.stack(np.meshgrid(*(e / DEG + f / DEG * nodes for e, f in zip(error, floor, strict=True)), indexing="ij"))
    share = np.einsum("i,j,k->ijk", weights, weights, weights) / np.sum(weights) ** 3
    sigma = float(np.sqrt(np.sum(share * (np.sqrt(np.mean(true**2, axis=0)) - size) ** 2)))
    errors = (tuple((error / DEG).tolist()), tuple((floor / DEG).tolist())) if sigma > 0 else None
    return Measured(CLOSURE_RUN, words, "°", size, sigma, errors=errors)


def known_sources(sources: Sequence[Source], covariance: np.ndarray) -> tuple[Source, ...]:
    """The sources of a covariance (P, P); where they are not told apart, one of them all whose size is taken as known."""
    matching = sources and sources[0].covariance.shape == covariance.shape and np.allclose(total(sources), covariance, rtol=1e-6, atol=0)
    return tuple(sources) if matching else (Source("all together", "A", float("inf"), covariance),)


def field_measured(
    vector: np.ndarray,
    sources: Sequence[Source],
    unobserved: tuple[str, ...] = (),
    moved: Callable[[np.ndarray], np.ndarray] | None = None,
) -> list[Measured]:
    """The 18 sensor errors of a linear model (12,), each with the degrees of freedom of its own mixture of sources (12, 12).

    moved: standard uncertainty (Q,) of quantities with a derivative (Q, 12) by one effect that the model lacks, as ``Systematic.of``; it is
    taken as known.
    """
    values, jacobian = field_vector(vector), field_jacobian(vector)
    parts = np.array([source.variance(jacobian) for source in sources])
    further = np.zeros(len(values)) if moved is None else moved(jacobian) ** 2
    freedoms = [*(source.freedom for source in sources), np.inf]
    quantities = field_quantities(vector, total(sources), unobserved)
    found = []
    for at, q in enumerate(quantities):
        scale = q.value / values[at] if values[at] else q.expanded / (2 * np.sqrt(parts[:, at].sum()))  # display unit per SI
        kind = f"gyro_{q.word.replace(' ', '_')}"
        unit, more = (KINDS[kind][1], 1e3 if q.unit == "dps" else 1.0)
        key = f"{kind}_{q.component.replace(' ', '_')}_{unit}"
        variances = [*parts[:, at].tolist(), float(further[at])]
        sigma, freedom = np.sqrt(sum(variances)) * abs(scale) * more, effective_freedom(variances, freedoms)
        found.append(Measured(key, f"gyroscope {q.word} {q.component}", unit, q.value * more, float(sigma), freedom, q.observed))
    return found


def accelerometer_measured(found: AccelerometerFit | None) -> list[Measured]:
    """The accelerometer's sensor errors; those of a calibration that was taken as given have no uncertainty here."""
    if found is None:
        return []
    measured, freedoms = [], dict(zip(ACCELEROMETER_NAMES, found.freedoms, strict=True))
    for word, unit, values, sigmas, names in found.errors():
        kind = f"accel_{word.replace(' ', '_')}"
        for number, (part, name) in enumerate(zip(KINDS[kind][0], names, strict=True)):
            sigma = float("nan") if sigmas is None else float(sigmas[number])
            key, words, observed = f"{kind}_{part}_{unit}", f"accelerometer {word} {part}", name not in found.unobserved
            measured.append(Measured(key, words, unit, float(values[number]), sigma, freedoms[name], observed))
    return measured


def attitude_measured(vector: np.ndarray, sources: Sequence[Source], unobserved: tuple[str, ...] = ()) -> Measured:
    """Expanded uncertainty (95 %) of the attitude about its worst axis after a minute at rest, from the calibration alone, degrees.

    k is that of the sources (12, 12) about that axis.  It is not observed where a parameter on which it depends is not.
    """
    model = LinearModel.from_vector(vector)
    slope = at_rest(model).slope(model)
    variances, axes = np.linalg.eigh(slope @ total(sources) @ slope.T)
    worst = axes[:, -1] @ slope
    freedom = effective_freedom([float(each.variance(worst[None])[0]) for each in sources], [each.freedom for each in sources])
    size = coverage_factor(freedom) * np.sqrt(max(float(variances[-1]), 0.0)) / DEG
    observed = not any(np.any(slope[:, NAMES.index(name)]) for name in unobserved if name in NAMES[:PARAMETERS])
    return Measured(ATTITUDE, "attitude after 60 s at rest, expanded uncertainty", "°", size, float("nan"), freedom, observed)


def conformity(requirements: Requirements, measured: Iterable[Measured]) -> list[Conformity]:
    """Each measured value that has limits, against them, in the order of the values; a value that is an uncertainty itself has no guard
    band, so that simple acceptance decides it."""
    asked = [(each, Rule() if each.key == ATTITUDE else requirements.rule) for each in measured if each.key in requirements.limits]
    return [Conformity(each, requirements.limits[each.key], rule, requirements.reference) for each, rule in asked]
