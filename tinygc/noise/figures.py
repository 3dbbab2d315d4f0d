"""The noise figures of a unit at rest: what ``noise.json`` holds, and what exports and ``explain`` read of it.

The terms are those of IEEE 952, annex C, with two-sided densities S(f), f in Hz, and Allan variances A(tau); u is the unit of the signal,
rad/s or m/s^2:

    Q   quantisation              S = (2 pi f)^2 Q^2 tau_0     A = 3 Q^2 / tau^2           u s
    N   angle random walk         S = N^2                      A = N^2 / tau               u/sqrt(Hz)
    B   bias instability          S = B^2 / (2 pi f)           A = 2 ln 2 / pi B^2         u
    K   rate random walk          S = K^2 / (2 pi f)^2         A = K^2 tau / 3             u/sqrt(s)
    R   ramp                      rate R t                     A = R^2 tau^2 / 2           u/s
    G   first-order Gauss-Markov  S = 2 G^2 T / (1 + (2 pi f T)^2), G its rms, T its correlation time    u, s

tau_0 is the sample period: Q is the rms error of the angle at each sample.  For an accelerometer N is the velocity random walk.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np

from session.base.records import Count, Key, Share, Size, read_record, record_of, table_of
from session.base.results import Array, Column, Keys, ListOf, Maybe, Number, Text
from session.base.texts import significant
from tinygc.inference.choose import ONE_SIDED

#: file of a unit's noise figures, next to ``fit.json``
FILE = "noise.json"
#: terms in the order of frequency, from the highest
TERMS = ("Q", "N", "G", "B", "K", "R")
NAMES = {
    "Q": "quantisation",
    "N": "random walk of the angle",
    "G": "Gauss-Markov",
    "B": "bias instability",
    "K": "random walk of the rate",
    "R": "ramp",
}
SENSORS = {"gyro": "gyroscope", "accel": "accelerometer"}
AGAIN = "measure the noise again"

#: units of each term's value, of the gyroscope and of the accelerometer
UNITS = {
    "gyro": {"Q": "rad", "N": "rad/s/sqrt(Hz)", "G": "rad/s", "B": "rad/s", "K": "rad/s/sqrt(s)", "R": "rad/s^2"},
    "accel": {"Q": "m/s", "N": "m/s^2/sqrt(Hz)", "G": "m/s^2", "B": "m/s^2", "K": "m/s^2/sqrt(s)", "R": "m/s^3"},
}


Above0 = Annotated[float, Number(0, above=True)]
Sizes = Annotated[np.ndarray, Array((3,), Number(0))]
Curve = Annotated[np.ndarray, Column(ListOf(Maybe(Number(0))))]

#: p-value of a misfit by chance; chi-square over its degrees of freedom up to which a misfit widens the sigmas, by a fifth, and no more
MISFIT, TOLERATED = 0.01, 1.5


def fits_data(p_value: float, excess: float) -> bool:
    """Whether terms describe their data: up to chance, or so nearly that wider sigmas cover it."""
    return p_value >= MISFIT or excess <= TOLERATED


@dataclass(frozen=True)
class Term:
    """One term of one axis, SI.

    value: its size, the mean over the sets of terms that may describe the log, 0 where it is not chosen; sigma: its standard deviation,
    with the other terms estimated and over those sets, None where it is not chosen; probability: that it is present; at_most: upper limit
    (95 %) of one that is not determined, None where the log sets none; tau_s, tau_sigma_s: correlation time of G and the sigma of its
    logarithm times itself.
    """

    value: Size
    sigma: Size | None
    probability: Share
    at_most: Size | None = None
    tau_s: Above0 | None = None
    tau_sigma_s: Size | None = None

    @property
    def chosen(self) -> bool:
        """Whether the log shows it."""
        return self.sigma is not None

    @property
    def is_determined(self) -> bool:
        """Whether its size is a number, and not a limit alone."""
        return self.chosen and self.at_most is None

    def is_known(self, relative: float) -> bool:
        """Whether its size is a number with at most this relative sigma."""
        return self.is_determined and (self.sigma or 0.0) <= relative * self.value

    @property
    def mean_square(self) -> float:
        """Mean of the square of its size over the sets of terms, SI squared, 0 where it is not chosen.

        Of terms that are limits alone, as B and K that are not separated, the squares of the means would add up to less than any set has.
        """
        return self.value**2 + (self.sigma**2 if self.sigma is not None and not self.is_determined else 0.0)


@dataclass(frozen=True)
class Line:
    """A line of the spectrum: frequency, Hz; rms, SI."""

    hz: Above0
    rms: Size


@dataclass(frozen=True, eq=False)
class AxisNoise:
    """terms: by name, a key for each of ``TERMS``; lines; p_value: of the model; excess: variance of the data over its own, 1 for a model
    that is right; from_s: shortest averaging time that the model describes; below it a filter or a vibration shapes the noise."""

    terms: Mapping[str, Term]
    lines: tuple[Line, ...] = ()
    p_value: Share | None = None
    excess: Size = 1.0
    from_s: Size = 0.0

    @property
    def is_described(self) -> bool:
        """Whether its terms describe the data."""
        return self.p_value is None or fits_data(self.p_value, self.excess)

    def value(self, name: str) -> float:
        """Size of a term, SI; 0 where it is not chosen."""
        return self.terms[name].value

    def allan_variance(self, tau_s: np.ndarray, only: str | None = None) -> np.ndarray:
        """(n,) u^2, of the model with averaging times (n,) s; only: of one term."""
        tau_s = np.asarray(tau_s, dtype=float)
        total = np.zeros(tau_s.shape)
        for name, term in self.terms.items():
            if term.value and only in (None, name):
                total = total + term.mean_square * unit_allan_variance(name, tau_s, term.tau_s or 1.0)
        for line in self.lines if only is None else ():
            x = np.pi * line.hz * tau_s
            total = total + 2 * line.rms**2 * np.sin(x) ** 4 / x**2
        return total


def unit_allan_variance(name: str, tau_s: np.ndarray, correlation_s: float = 1.0) -> np.ndarray:
    """Allan variance (n,) at tau_s (n,) of a term of size 1 (IEEE 952, annex C)."""
    tau_s = np.asarray(tau_s, dtype=float)
    if name == "G":
        x = tau_s / correlation_s
        # 2 x - 3 + 4 exp(-x) - exp(-2 x) = 2 x^3 / 3 - x^4 / 2 + ..., which loses its digits for small x
        return np.where(x < 1e-3, 2 * x / 3 - x**2 / 2, (2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x)) / np.maximum(x, 1e-9) ** 2)
    return {
        "Q": 3 / tau_s**2,
        "N": 1 / tau_s,
        "B": np.full(tau_s.shape, 2 * np.log(2) / np.pi),
        "K": tau_s / 3,
        "R": tau_s**2 / 2,
    }[name]


@dataclass(frozen=True, eq=False)
class SensorNoise:
    """Noise of the gyroscope or of the accelerometer: a record for each axis x, y, z of the log."""

    axes: tuple[AxisNoise, AxisNoise, AxisNoise]

    @property
    def is_described(self) -> bool:
        """Whether the terms describe the data of each axis."""
        return all(axis.is_described for axis in self.axes)

    def values(self, name: str) -> np.ndarray:
        """(3,) SI: size of a term on each axis, 0 where it is not chosen."""
        return np.array([axis.value(name) for axis in self.axes])

    def measured(self, name: str) -> bool:
        """Whether a term's size is a number on some axis, and not a limit alone."""
        return any(axis.terms[name].is_determined for axis in self.axes)

    def at_most(self, name: str) -> np.ndarray:
        """(3,) SI: upper limit of a term on each axis (95 %); infinite where the log sets none."""
        return np.array([_limit(axis.terms[name]) for axis in self.axes])


def _limit(term: Term) -> float:
    if term.sigma is not None and term.at_most is None:
        return term.value + ONE_SIDED * term.sigma
    return float("inf") if term.at_most is None else term.at_most


@dataclass(frozen=True, eq=False)
class Inflation:
    """By what a filter's densities are to be larger than N and K on one kind of motion.

    motion: the kind; white, walk (3,): factors on the white and on the walk density of each axis, the latter 1 where K is 0; parts: name of
    a cause -> the factor (3,) on the white density that it alone would need; squares less one add up; source: what it was measured on.
    white_sigma (3,): of the white factor; at_most (3,): its upper limit (95 %), with what the recording cannot exclude; white_density,
    walk_density (3,) SI: the densities themselves.  Those four are None where they are not known.
    """

    motion: str
    white: Sizes
    walk: Sizes
    parts: Mapping[str, Sizes] = field(default_factory=dict)
    source: str = ""
    white_sigma: Sizes | None = None
    at_most: Sizes | None = None
    white_density: Sizes | None = None
    walk_density: Sizes | None = None


@dataclass(frozen=True, eq=False)
class AllanBand:
    """Allan deviation of one sensor: tau_s (K,); deviation, low, high (K, 3) SI, with 68 % bounds; NaN where an axis has none."""

    tau_s: Annotated[np.ndarray, Column(Number(0, above=True))]
    deviation: Curve
    low: Curve
    high: Curve

    @staticmethod
    def fault(table: Mapping[str, Any]) -> str:
        """Which column has not three numbers for each averaging time; empty where all have."""
        for name in ("deviation", "low", "high"):
            if len(table[name]) != len(table["tau_s"]) or any(len(row) != 3 for row in table[name]):
                return f"{name}: expected a row of three numbers for each of tau_s"
        return ""


@dataclass(frozen=True)
class OfSensor(Keys):
    """The axes of a sensor in ``noise.json``, whose terms have its units and no others: nothing is converted."""

    units: Mapping[str, str] = field(default_factory=dict)

    def made(self, value: Any) -> SensorNoise:
        """Of a table that was checked."""
        x, y, z = (AxisNoise(**axis) for axis in super().made(value).values())
        return SensorNoise((x, y, z))

    def written(self, sensor: SensorNoise) -> dict[str, Any]:
        """Each term with its unit; a correlation time of G alone."""
        axes = dict(zip("xyz", map(table_of, sensor.axes), strict=True))
        for axis in axes.values():
            for name, term in axis["terms"].items():
                term = {"value": 0.0, "sigma": None, "unit": self.units[name]} | term
                axis["terms"][name] = {key: each for key, each in term.items() if name == "G" or not key.startswith("tau")}
        return axes


def _of_sensor(kind: str) -> OfSensor:
    term, axis = record_of(Term), record_of(AxisNoise)
    no_time = tuple(entry for entry in term.entries if not entry.name.startswith("tau"))
    terms = {}
    for name, unit in UNITS[kind].items():
        entries = term.entries if name == "G" else no_time
        may = {entry.name: entry.shape for entry in entries if entry.name not in term.must}
        terms[name] = replace(term, may={**may, "unit": Text((unit,))}, entries=entries)
    return OfSensor(dict.fromkeys("xyz", Keys({"terms": Keys(terms)}, axis.may)), {}, UNITS[kind])


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseFigures:
    """Noise figures of one unit.

    gyro (rad/s), accel (m/s^2; None: the logs held none); rate_hz of the samples; duration_s and samples that were used; logs: names of the
    files; sensor: its model; serial; inflations: of the gyroscope, by kind of motion; allan: curves of ``gyro`` and ``accel``,
    those that are kept for pictures; rate_known: whether rate_hz was measured or stated, and is no guess.
    """

    schema: ClassVar[str] = "tinygc-noise/1"
    sensor: str = ""
    serial: str = ""
    logs: tuple[str, ...] = ()
    rate_hz: Above0
    rate_known: bool = True
    duration_s: Size
    samples: Annotated[Count, Key(absent=0)]
    gyro: Annotated[SensorNoise, _of_sensor("gyro")]
    accel: Annotated[SensorNoise | None, _of_sensor("accel")]
    inflations: tuple[Inflation, ...] = ()
    allan: Annotated[Mapping[str, AllanBand], Keys(may=dict.fromkeys(UNITS, record_of(AllanBand))), Key(if_known=True)] = field(
        default_factory=dict
    )

    def sensors(self) -> dict[str, SensorNoise]:
        """By ``gyro`` and ``accel``, those that are there."""
        return {"gyro": self.gyro} | ({} if self.accel is None else {"accel": self.accel})


#: s: what the terms do not describe below it is usual, of a sensor's own filter, and is not reported
LATE_S = 1.0


def described_from(figures: NoiseFigures) -> list[str]:
    """One line on the axes that the terms describe only from an averaging time of ``LATE_S`` or more; none where there is none."""
    late = [
        f"{SENSORS[kind]} {name} {significant(axis.from_s, 2)} s on"
        for kind, sensor in figures.sensors().items()
        for name, axis in zip("xyz", sensor.axes, strict=True)
        if axis.is_described and axis.from_s >= LATE_S
    ]
    return [f"Described from: {', '.join(late)}; faster, a filter or a vibration shapes it."] if late else []


def read_figures(path: Path) -> NoiseFigures:
    """Read ``noise.json`` (docs/formats/noise.md).  Raises FormatError for what it does not hold."""
    return read_record(NoiseFigures, path, AGAIN)
