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
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.numeric import finite_or_none
from session.base.results import Array, Flag, Keys, ListOf, MapOf, Maybe, Number, Shape, Text, read_required

SCHEMA = "tinygc-noise/1"
#: file of a unit's noise figures, beside ``fit.json``
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
AGAIN = "write it again with `calibrate noise`"


#: of a normal distribution
ONE_SIDED_95 = 1.645
#: p-value of a misfit by chance; chi-square over its degrees of freedom up to which a misfit widens the sigmas, by a fifth, and no more
MISFIT, TOLERATED = 0.01, 1.5


def fits_data(p_value: float, excess: float) -> bool:
    """Whether terms describe their data: up to chance, or so nearly that wider sigmas say it."""
    return p_value >= MISFIT or excess <= TOLERATED


@dataclass(frozen=True)
class Term:
    """One term of one axis, SI.

    value: its size, the mean over the sets of terms that may describe the log, 0 where it is not chosen; sigma: its standard deviation,
    with the other terms estimated and over those sets, None where it is not chosen; probability: that it is present; at_most: upper limit
    (95 %) of one that is not determined, None where the log sets none; tau_s, tau_sigma_s: correlation time of G and the sigma of its
    logarithm times itself.
    """

    value: float
    sigma: float | None
    probability: float
    at_most: float | None = None
    tau_s: float | None = None
    tau_sigma_s: float | None = None

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

        Of terms that are limits alone, as B and K that are not told apart, the squares of the means would add up to less than any set has.
        """
        return self.value**2 + (self.sigma**2 if self.sigma is not None and not self.is_determined else 0.0)


@dataclass(frozen=True)
class Line:
    """A line of the spectrum: frequency, Hz; rms, SI."""

    hz: float
    rms: float


@dataclass(frozen=True, eq=False)
class AxisNoise:
    """terms: by name, a key for each of ``TERMS``; lines; p_value: of the model; excess: variance of the data over its own, 1 for a model
    that is right; from_s: shortest averaging time that the model describes; below it a filter or a vibration shapes the noise."""

    terms: Mapping[str, Term]
    lines: tuple[Line, ...] = ()
    p_value: float | None = None
    excess: float = 1.0
    from_s: float = 0.0

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
        return term.value + ONE_SIDED_95 * term.sigma
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
    white: np.ndarray
    walk: np.ndarray
    parts: Mapping[str, np.ndarray] = field(default_factory=dict)
    source: str = ""
    white_sigma: np.ndarray | None = None
    at_most: np.ndarray | None = None
    white_density: np.ndarray | None = None
    walk_density: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class AllanBand:
    """Allan deviation of one sensor: tau_s (K,); deviation, low, high (K, 3) SI, with 68 % bounds; NaN where an axis has none."""

    tau_s: np.ndarray
    deviation: np.ndarray
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class NoiseFigures:
    """Noise figures of one unit.

    gyro (rad/s), accel (m/s^2; None: the logs held none); rate_hz of the samples; duration_s and samples that were used; logs: names of the
    files; sensor: its model; serial; inflations: of the gyroscope, by kind of motion; allan: curves of ``gyro`` and ``accel``,
    those that are kept for pictures; rate_known: whether rate_hz was measured or stated, and is no guess.
    """

    gyro: SensorNoise
    accel: SensorNoise | None
    rate_hz: float
    duration_s: float
    samples: int
    logs: tuple[str, ...] = ()
    sensor: str = ""
    serial: str = ""
    inflations: tuple[Inflation, ...] = ()
    allan: Mapping[str, AllanBand] = field(default_factory=dict)
    rate_known: bool = True

    def sensors(self) -> dict[str, SensorNoise]:
        """By ``gyro`` and ``accel``, those that are there."""
        return {"gyro": self.gyro} | ({} if self.accel is None else {"accel": self.accel})


#: s: what the terms do not describe below it is usual, of a sensor's own filter, and is not said
LATE_S = 1.0


def described_from(figures: NoiseFigures) -> list[str]:
    """One line on the axes that the terms describe only from an averaging time of ``LATE_S`` or more; none where there is none."""
    late = [
        f"{SENSORS[kind]} {name} {axis.from_s:.2g} s on"
        for kind, sensor in figures.sensors().items()
        for name, axis in zip("xyz", sensor.axes, strict=True)
        if axis.is_described and axis.from_s >= LATE_S
    ]
    return [f"Described from: {', '.join(late)}; faster, a filter or a vibration shapes it."] if late else []


# The file.

#: units of each term's value, of the gyroscope and of the accelerometer
UNITS = {
    "gyro": {"Q": "rad", "N": "rad/s/sqrt(Hz)", "G": "rad/s", "B": "rad/s", "K": "rad/s/sqrt(s)", "R": "rad/s^2"},
    "accel": {"Q": "m/s", "N": "m/s^2/sqrt(Hz)", "G": "m/s^2", "B": "m/s^2", "K": "m/s^2/sqrt(s)", "R": "m/s^3"},
}
_SIZE = Number(0)


def _shape_of(units: Mapping[str, str]) -> Keys:
    """Shape of a sensor whose terms have these units, and no others: nothing is converted."""
    must: dict[str, Shape] = {"value": _SIZE, "sigma": Maybe(_SIZE), "probability": Number(0, 1)}
    may: dict[str, Shape] = {"at_most": Maybe(_SIZE), "tau_s": Maybe(Number(0, above=True)), "tau_sigma_s": Maybe(_SIZE)}
    terms = {name: Keys(must, may | {"unit": Text((unit,))}) for name, unit in units.items()}
    line = Keys({"hz": Number(0, above=True), "rms": _SIZE})
    axis = Keys({"terms": Keys(terms)}, {"lines": ListOf(line), "p_value": Maybe(Number(0, 1)), "excess": _SIZE, "from_s": _SIZE})
    return Keys(dict.fromkeys("xyz", axis))


_FACTORS = Array((3,), _SIZE)
#: keys of an inflation that may be null
_MORE = ("white_sigma", "at_most", "white_density", "walk_density")
_CURVE = ListOf(ListOf(Maybe(_SIZE)))
_BAND = Keys({"tau_s": ListOf(Number(0, above=True)), "deviation": _CURVE, "low": _CURVE, "high": _CURVE})
SHAPE = Keys(
    {
        "schema": Text((SCHEMA,)),
        "gyro": _shape_of(UNITS["gyro"]),
        "accel": Maybe(_shape_of(UNITS["accel"])),
        "rate_hz": Number(0, above=True),
        "duration_s": _SIZE,
    },
    {
        "rate_known": Flag(),
        "samples": Number(0, whole=True),
        "logs": ListOf(Text()),
        "sensor": Text(),
        "serial": Text(),
        "allan": Keys({}, {"gyro": _BAND, "accel": _BAND}),
        "inflations": ListOf(
            Keys(
                {"motion": Text(), "white": _FACTORS, "walk": _FACTORS},
                {"parts": MapOf(_FACTORS), "source": Text(), **dict.fromkeys(_MORE, Maybe(_FACTORS))},
            ),
        ),
    },
)


def read_figures(path: Path) -> NoiseFigures:
    """Read ``noise.json`` (docs/formats/noise.md).  Raises FormatError for what it does not hold."""
    table = read_required(path, SHAPE, AGAIN)
    accel = table["accel"]
    return NoiseFigures(
        gyro=_sensor(table["gyro"]),
        accel=None if accel is None else _sensor(accel),
        rate_hz=table["rate_hz"],
        duration_s=table["duration_s"],
        samples=int(table.get("samples", 0)),
        logs=tuple(table.get("logs", ())),
        sensor=table.get("sensor", ""),
        serial=table.get("serial", ""),
        inflations=tuple(
            Inflation(
                each["motion"],
                np.array(each["white"], dtype=float),
                np.array(each["walk"], dtype=float),
                {name: np.array(part, dtype=float) for name, part in each.get("parts", {}).items()},
                each.get("source", ""),
                **{name: None if each.get(name) is None else np.array(each[name], dtype=float) for name in _MORE},
            )
            for each in table.get("inflations", ())
        ),
        allan={kind: _band(band, f"{path}: allan.{kind}") for kind, band in table.get("allan", {}).items() if kind in UNITS},
        rate_known=table.get("rate_known", True),
    )


def _band(table: dict, where: str) -> AllanBand:
    """A curve.  Raises FormatError for columns of another shape."""
    tau_s = np.array(table["tau_s"], dtype=float)
    for name in ("deviation", "low", "high"):
        if len(table[name]) != len(tau_s) or any(len(row) != 3 for row in table[name]):
            raise FormatError(f"{where}.{name}: expected a row of three numbers for each of tau_s; {AGAIN}")
    deviation, low, high = (np.array(table[name], dtype=float).reshape(-1, 3) for name in ("deviation", "low", "high"))
    return AllanBand(tau_s, deviation, low, high)


def _sensor(table: dict) -> SensorNoise:
    x, y, z = (_axis(table[axis]) for axis in "xyz")
    return SensorNoise((x, y, z))


def _axis(table: dict) -> AxisNoise:
    names = ("value", "sigma", "probability", "at_most", "tau_s", "tau_sigma_s")
    return AxisNoise(
        {key: Term(**{name: each[name] for name in names if name in each}) for key, each in table["terms"].items()},
        tuple(Line(each["hz"], each["rms"]) for each in table.get("lines", ())),
        table.get("p_value"),
        table.get("excess", 1.0),
        table.get("from_s", 0.0),
    )


def to_json(figures: NoiseFigures) -> dict:
    """``tinygc-noise/1`` (docs/formats/noise.md)."""
    return {
        "schema": SCHEMA,
        "sensor": figures.sensor,
        "serial": figures.serial,
        "logs": list(figures.logs),
        "rate_hz": figures.rate_hz,
        "rate_known": figures.rate_known,
        "duration_s": figures.duration_s,
        "samples": figures.samples,
        "gyro": _sensor_json(figures.gyro, "gyro"),
        "accel": None if figures.accel is None else _sensor_json(figures.accel, "accel"),
        "inflations": [
            {
                "motion": each.motion,
                "white": each.white.tolist(),
                "walk": each.walk.tolist(),
                "parts": {name: part.tolist() for name, part in each.parts.items()},
                "source": each.source,
                **{name: None if (value := getattr(each, name)) is None else value.tolist() for name in _MORE},
            }
            for each in figures.inflations
        ],
        **({} if not figures.allan else {"allan": {kind: _band_json(band) for kind, band in figures.allan.items()}}),
    }


def _band_json(band: AllanBand) -> dict:
    columns = {name: getattr(band, name) for name in ("deviation", "low", "high")}
    return {"tau_s": band.tau_s.tolist()} | {
        name: [[finite_or_none(value) for value in row] for row in rows] for name, rows in columns.items()
    }


def _sensor_json(sensor: SensorNoise, kind: str) -> dict:
    return {axis: _axis_json(own, UNITS[kind]) for axis, own in zip("xyz", sensor.axes, strict=True)}


def _axis_json(axis: AxisNoise, units: Mapping[str, str]) -> dict:
    terms = {
        name: {
            "value": term.value,
            "sigma": term.sigma,
            "unit": units[name],
            "probability": term.probability,
            "at_most": term.at_most,
            **({"tau_s": term.tau_s, "tau_sigma_s": term.tau_sigma_s} if name == "G" else {}),
        }
        for name, term in axis.terms.items()
    }
    lines = [{"hz": line.hz, "rms": line.rms} for line in axis.lines]
    return {"terms": terms, "lines": lines, "p_value": axis.p_value, "excess": axis.excess, "from_s": axis.from_s}
