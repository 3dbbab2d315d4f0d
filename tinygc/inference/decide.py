"""Decide: whether a measured value with its uncertainty meets its limits, with which risk, and the one answer of a result.

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

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import measured, probability, significant
from session.log.requirements import ATTITUDE, SIMPLE, Rule
from tinygc.inference.solve import coverage_factor

# The one answer of a result.


class Kind(NamedTuple):
    """What an answer is called, its style on a terminal, and the exit code of a command whose verdict it is."""

    word: str
    style: str = ""
    exit_code: int = 0


#: whether a calibration, or a requirement of it, is met
HOLDS, BIAS, FAILS, UNDECIDED = "holds", "holds with a new bias", "does not hold", "undecided"
#: every answer that a result of this program has
KINDS = {
    "pass": Kind("PASS", "bold green"),
    "doubtful pass": Kind("PASS, with doubts", "bold yellow"),
    "no limit": Kind("DOWN TO NOISE", "bold green"),
    "not decided": Kind("NOT DECIDED", "bold yellow"),
    "fail": Kind("FAIL", "bold red", 1),
    HOLDS: Kind("HOLDS", "bold green"),
    BIAS: Kind("HOLDS WITH A NEW BIAS", "bold yellow", 1),
    FAILS: Kind("DOES NOT HOLD", "bold red", 1),
    UNDECIDED: Kind("UNDECIDED", "bold", 5),
    "common": Kind("common", "bold"),
    "own": Kind("own", "bold"),
    "common_and_own": Kind("common and own", "bold"),
    "no_mismatch": Kind("nothing beyond the model shows", "green"),
    "explained": Kind("explained", "green"),
    "ambiguous": Kind("explained, but lookalikes fit as well", "yellow"),
    "partly_explained": Kind("partly explained: something without a name is left", "yellow"),
    "unexplained": Kind("no effect of the catalogue fits the mismatch", "red"),
    "suspected": Kind("a mismatch is suspected; noise alone shows as much in a share p of clean sessions", "yellow"),
    "clean": Kind("no error of table or sensor is seen", "green"),
    "table": Kind("an error of the table", "green"),
    "sensor": Kind("an error of the sensor, and none of the table", "green"),
    "both": Kind("errors of table and sensor", "green"),
    "confirmed": Kind("confirmed", "green"),
    "another size": Kind("another size", "yellow"),
    "not confirmed": Kind("not confirmed", "yellow"),
    "contradicted": Kind("contradicted", "bold red"),
    **{word: Kind(word) for word in ("no power", "of one recording", "of one unit", "no numbers")},
}


@dataclass(frozen=True)
class Answer:
    """kind, of ``KINDS``; line: the reason, in one line; do: what to do."""

    kind: str
    line: str
    do: str = ""

    @property
    def of(self) -> Kind:
        """Its word, style and exit code."""
        return KINDS[self.kind]

    @property
    def headline(self) -> str:
        """The answer and its reason, in one line."""
        return f"{self.of.word}: {self.line}"


# A value against its limits.

Verdict = Literal["pass", "fail", "not decided"]


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
    if not any(sigmas):
        return float(rms_of(np.array(errors)) <= limit)
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


@dataclass(frozen=True)
class Fact:
    """A number that a result states.

    word: what it is; unit; value and sigma, its standard uncertainty (NaN: not known), in that unit; freedom: degrees of freedom of u;
    observed: whether the session determines it; component of the word: ``x``, ``x to y``; key: of ``session.log.requirements``; moved: how
    far one effect missing from the model may have moved it, a standard uncertainty as well, or NaN; at_most: limit of what is not observed,
    or NaN; note: a remark for the reader; relative: whether it is decided on the scale of logarithms, as a size is whose scatter grows
    with it (sigma then is value times that of the logarithm); errors: three errors and the sigma of each, whose root mean square it is.
    """

    word: str
    unit: str
    value: float
    sigma: float = float("nan")
    freedom: float = float("inf")
    observed: bool = True
    component: str = ""
    key: str = ""
    moved: float = float("nan")
    at_most: float = float("nan")
    note: str = ""
    relative: bool = False
    errors: tuple[tuple[float, ...], tuple[float, ...]] | None = None

    @property
    def name(self) -> str:
        """Word and component."""
        return f"{self.word} {self.component}".strip()

    @property
    def u(self) -> float:
        """Combined standard uncertainty, in the unit."""
        return float(np.hypot(self.sigma, np.nan_to_num(self.moved)))

    @property
    def factor(self) -> float:
        """Coverage factor k of 95 %."""
        return coverage_factor(self.freedom)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k u."""
        return self.factor * self.u

    @property
    def stated(self) -> str:
        """Value ± U to two digits of U, the value alone where U is not known, or that it is not observed."""
        if not self.observed or not np.isfinite(self.value):
            return "not observed" + ("" if np.isnan(self.at_most) else f"; at most {significant(self.at_most, 2)}")
        return measured(self.value, self.expanded) if self.expanded > 0 else significant(self.value)


@dataclass(frozen=True)
class Conformity:
    """Whether a measured value meets its limits (lower, upper) by a rule; reference: where the limits are from."""

    measured: Fact
    limits: tuple[float, float]
    rule: Rule
    reference: str = ""

    @cached_property
    def _scaled(self) -> tuple[float, float, tuple[float, float]]:
        """Value, sigma and limits on the scale on which it is decided."""
        m = self.measured
        if not m.relative:
            return m.value, m.u, self.limits
        lower, upper = (float(np.log(limit)) if limit > 0 else -np.inf for limit in self.limits)
        return float(np.log(m.value)), m.u / m.value, (lower, upper)

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
            further = (inwards - near) * self.measured.u
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
    def answer(self) -> Verdict:
        """PASS, FAIL or NOT DECIDED; the last for what the session does not determine."""
        value = self.measured.value
        if not self.measured.observed or not np.isfinite(value):
            return "not decided"
        if self.rule.kind == SIMPLE:
            if self.rule.least_ratio is not None and (self.ratio is None or self.ratio < self.rule.least_ratio):
                return "not decided"
            return "pass" if simply_accepted(value, self.limits) else "fail"
        if not np.isfinite(self.measured.u):
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
        if self.answer == "not decided" or not np.isfinite(self.measured.u):
            return None
        return 1 - self.probability if self.answer == "pass" else self.probability

    @property
    def limit_words(self) -> str:
        """The limits, in the unit of the value."""
        lower, upper = self.limits
        unit = self.measured.unit if self.measured.unit == "°" else f" {self.measured.unit}"
        if not np.isfinite(lower):
            return f"at most {significant(upper)}{unit}"
        if not np.isfinite(upper):
            return f"at least {significant(lower)}{unit}"
        return f"{significant(lower)} to {significant(upper)}{unit}"

    @property
    def value_words(self) -> str:
        """The value with U, to two digits of U."""
        m = self.measured
        if not m.observed or not np.isfinite(m.value):
            return m.stated
        unit = m.unit if m.unit == "°" else f" {m.unit}"
        return f"{m.stated}{unit}"

    @property
    def risk_words(self) -> str:
        """What the answer risks; of an undecided value, what either answer would."""
        if self.measured.key == ATTITUDE:
            return "no risk is stated, since the value is an uncertainty itself"
        if not np.isfinite(self.measured.u) or not self.measured.observed:
            return "its uncertainty is not known, and so is the risk"
        wrong = {"pass": 1 - self.probability, "fail": self.probability}
        if self.risk is not None:
            return f"risk that this {self.answer.upper()} is wrong: {share_words(self.risk)}"
        return f"a PASS would be wrong with {probability(wrong['pass'])}, a FAIL with {probability(wrong['fail'])}"

    @property
    def words(self) -> str:
        """The whole statement in one line."""
        return f"{self.measured.name}: {self.value_words}, required {self.limit_words}: {self.answer.upper()}; {self.risk_words}"

    def to_json(self) -> dict:
        """Return an entry of ``conformity`` of ``tinygc-fit/2``; null for what is not known, or has no limit."""
        m = self.measured
        numbers = {
            "value": m.value if m.observed else None,
            "standard_uncertainty": m.u,
            "degrees_of_freedom": m.freedom,
            "coverage_factor": m.factor,
            "expanded_uncertainty": m.expanded,
            "lower": self.limits[0],
            "upper": self.limits[1],
            "guard_band": self.band,
            "test_uncertainty_ratio": self.ratio,
            "conformity_probability": self.probability if np.isfinite(m.u) and m.observed else None,
            "risk": self.risk,
        }
        known = {key: value if value is not None and np.isfinite(value) else None for key, value in numbers.items()}
        return {"quantity": m.key, "name": m.name, "unit": m.unit, "rule": self.rule.kind, "answer": self.answer} | known


def share_words(share: float) -> str:
    """A probability as a share in percent, or its bound."""
    return "below 0.01 %" if share < 1e-4 else f"{significant(100 * share, 2)} %"
