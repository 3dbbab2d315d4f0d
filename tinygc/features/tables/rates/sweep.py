"""Gain and phase of a sensor on a table that swings: bandwidth and delay (IEEE 1431, 12.15).

    H(f) = K L(f) exp(-2 pi i f D),   L = 1  |  1 / (1 + i f/fc)  |  1 / (1 + 2 i zeta f/f0 - (f/f0)^2)

The output of the sensor over the rate that the machine's angles give.  D holds the sensor's pure delay less the machine's latency: its
angles reach the log late.  The two cannot be separated; the delay is the sensor's own only where ``table.toml`` states the latency.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from session.base.errors import DataError, FormatError
from session.base.numeric import rms_of
from session.base.texts import measured, printable, significant
from session.base.units import DEG
from tinygc.features.tables.rates.points import numbers_in, read_table
from tinygc.inference.choose import of_any_scale, weights_of
from tinygc.inference.solve import solve

#: least number of frequencies of a sweep
LEAST = 4
#: columns of a CSV
FREQUENCY, GAIN, PHASE = ("frequency_hz", "frequency", "f_hz", "freq_hz", "freq"), ("gain", "magnitude", "ratio"), ("phase_deg", "phase")
#: models: name, words, and where the fit of their shape parameters begins (of the largest frequency; damping)
MODELS: dict[str, tuple[str, tuple[tuple[float, ...], ...]]] = {
    "flat": ("flat", ((),)),
    "first": ("first order", ((1.0,), (0.25,))),
    "second": ("second order", ((1.0, 0.7), (1 / 3, 0.7), (2.0, 0.3))),
}
#: beyond any table and any sensor
MOST_HZ, MOST_GAIN, MOST_DELAY_S = 1e5, 1e6, 10.0
#: chi-square of a row below which a model leaves nothing
LEAST_LEFT = 1e-12
#: what a model may leave of gain and phase, rms, as a share and in rad, and still describe them
POOR = 0.05


@dataclass(frozen=True, eq=False)
class Response:
    """Gain (N,) and phase (N,) rad of a sensor at frequencies (N,) Hz, with their sigmas; latency_s: declared, None where it is not."""

    name: str
    frequency_hz: np.ndarray
    gain: np.ndarray
    phase: np.ndarray
    gain_sigma: np.ndarray
    phase_sigma: np.ndarray
    latency_s: float | None = None


@dataclass(frozen=True, eq=False)
class Sweep:
    """A response and its model: parameters K, D s, and fc Hz, or f0 Hz and zeta; covariance (p, p) of these; bandwidth_hz where the gain
    is 0.707 of K, None where no frequency shows it, and then bandwidth_at_least_hz; probability: of the model among the others."""

    response: Response
    model: str
    vector: np.ndarray
    covariance: np.ndarray
    bandwidth_hz: float | None
    bandwidth_sigma_hz: float | None
    bandwidth_at_least_hz: float | None
    probability: float

    @property
    def gain(self) -> tuple[float, float]:
        """K and its sigma."""
        return float(self.vector[0]), float(np.sqrt(self.covariance[0, 0]))

    @property
    def delay_s(self) -> tuple[float, float]:
        """D and its sigma, s: the sensor's where the latency is declared, else less the table's latency."""
        return float(self.vector[1]), float(np.sqrt(self.covariance[1, 1]))

    @cached_property
    def rows_deg(self) -> list[tuple[float, float, float, float, float]]:
        """Frequency Hz, gain, its sigma, phase °, its sigma."""
        r = self.response
        rows = np.stack([r.frequency_hz, r.gain, r.gain_sigma, r.phase / DEG, r.phase_sigma / DEG], axis=1)
        return [tuple(row) for row in rows.tolist()]

    @property
    def headline(self) -> str:
        """Which log, and how many frequencies."""
        return f"{printable(self.response.name)}: gain and phase at {len(self.response.gain)} frequencies, {MODELS[self.model][0]}"

    @property
    def lines(self) -> list[str]:
        """Gain, bandwidth and delay in words."""
        delay, sigma = (1e3 * value for value in self.delay_s)
        if self.bandwidth_hz is None:
            band = f"above {significant(self.bandwidth_at_least_hz or 0.0)} Hz"
        else:
            band = f"{measured(self.bandwidth_hz, self.bandwidth_sigma_hz or 0.0)} Hz"
        known = self.response.latency_s is not None
        whose = (
            "the sensor's, the table's declared latency taken off"
            if known
            else "the sensor's less the table's latency, which is not declared"
        )
        reported = [f"gain {measured(*self.gain)}; −3 dB at {band}; delay {measured(delay, sigma)} ms: {whose}"]
        if delay < -2 * sigma and known:
            reported.append("a delay below zero: the declared latency is too small, or the phase has the other sign")
        gain_left, phase_left = self.left
        reported.append(f"the model leaves {100 * gain_left:.2g} % of the gain and {phase_left / DEG:.2g}° of the phase, rms")
        if max(gain_left, phase_left) > POOR:
            reported.append("it does not describe these points: bandwidth and delay are not theirs; measure again, at more frequencies")
        return reported

    @property
    def left(self) -> tuple[float, float]:
        """What the model leaves, rms: of the gain, as a share of it, and of the phase, rad."""
        ratio = self.response.gain * np.exp(1j * self.response.phase) / transfer(self.model, self.response.frequency_hz, self.vector)
        return rms_of(np.abs(ratio) - 1), rms_of(np.angle(ratio))


def transfer(model: str, frequency_hz: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """(N,) complex H of a model at frequencies (N,) Hz."""
    gain, delay_s, *shape = vector
    if model == "flat":
        low = np.ones(len(frequency_hz), dtype=complex)
    elif model == "first":
        low = 1 / (1 + 1j * frequency_hz / shape[0])
    else:
        ratio = frequency_hz / shape[0]
        low = 1 / (1 + 2j * shape[1] * ratio - ratio**2)
    return gain * low * np.exp(-2j * np.pi * frequency_hz * delay_s)


def fit_response(response: Response) -> Sweep:
    """The most probable model.  Raises DataError for fewer frequencies than its numbers need."""
    if len(np.unique(response.frequency_hz)) < LEAST:
        raise DataError(f"{printable(response.name)}: {len(np.unique(response.frequency_hz))} frequencies, expected at least {LEAST}")
    fits = {model: fit for model in MODELS if (fit := _fit(response, model)) is not None}
    rows, (_, _, flat) = 2 * len(response.gain), fits["flat"]
    shares = weights_of([float(of_any_scale(squares, rows - len(vector), len(vector), flat)) for vector, _, squares in fits.values()])
    best = int(np.argmax(shares))
    model, (vector, covariance, _) = [*fits.items()][best]
    return Sweep(response, model, vector, covariance, *_bandwidth(response, model, vector, covariance), float(shares[best]))


def _fit(response: Response, model: str) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Numbers, covariance, chi-square; None where there are too few frequencies."""
    from scipy.optimize import least_squares

    f, top, starts = response.frequency_hz, float(response.frequency_hz.max()), MODELS[model][1]
    size = 2 + len(starts[0])
    if 2 * len(f) <= 1 + size:
        return None

    def residuals(vector: np.ndarray) -> np.ndarray:
        ratio = transfer(model, f, vector) / (response.gain * np.exp(1j * response.phase))
        return np.concatenate([np.log(np.abs(ratio)) / (response.gain_sigma / response.gain), np.angle(ratio) / response.phase_sigma])

    gain, order = float(response.gain[np.argmin(f)]), np.argsort(f)
    slope_s = -float(np.polyfit(2 * np.pi * f[order], np.unwrap(response.phase[order]), 1)[0])
    bounds = [0.0, -MOST_DELAY_S, 1e-6, 0.01][:size], [np.inf, MOST_DELAY_S, 10 * MOST_HZ, 10.0][:size]
    unit = np.array([gain, 1 / (2 * np.pi * top), top, 1.0][:size])
    found = min(
        (
            least_squares(residuals, [gain, delay_s, *(start * unit[2:])], bounds=bounds, x_scale=unit, max_nfev=300)
            for start in starts
            for delay_s in (0.0, float(np.clip(slope_s, -MOST_DELAY_S / 2, MOST_DELAY_S / 2)))
        ),
        key=lambda solved: float(solved.cost),
    )
    chi_square = max(float(2 * found.cost), LEAST_LEFT * 2 * len(f))
    widened = max(chi_square / max(2 * len(f) - size, 1), 1.0)  # what the model leaves widens its sigmas
    return found.x, solve(found.jac).covariance * widened, chi_square


def _bandwidth(
    response: Response, model: str, vector: np.ndarray, covariance: np.ndarray
) -> tuple[float | None, float | None, float | None]:
    """Where the gain falls to 0.707 of K: Hz, sigma, or a lower limit where no frequency comes near."""

    def at(shape: np.ndarray) -> float:
        a = 1 - 2 * shape[1] ** 2 if model == "second" else 0.0
        return float(shape[0] * np.sqrt(a + np.sqrt(a**2 + 1)))

    top, shape, part = float(response.frequency_hz.max()), vector[2:], covariance[2:, 2:]
    if model != "flat" and np.isfinite(part).all():  # else these frequencies do not determine where the gain falls
        slopes = np.array([(at(shape + step) - at(shape - step)) / (2 * step.sum()) for step in np.diag(1e-5 * shape)])
        band, sigma = at(shape), float(np.sqrt(max(slopes @ part @ slopes, 0.0)))
        if band - 2 * sigma <= 3 * top:
            return band, sigma, None
    return None, None, top


def is_response(header: list[str]) -> bool:
    """Whether a CSV's header is that of gains and phases at frequencies."""
    return _column(header, FREQUENCY) is not None and _column(header, GAIN) is not None


def _column(header: list[str], names: tuple[str, ...]) -> int | None:
    """The column with the first of these names, which hold its unit: a gain in dB, or a phase in rad, is none."""
    plain = [name.lower() for name in header]
    return next((plain.index(name) for name in names if name in plain), None)


def read_response(path: Path) -> Response:
    """Gain and phase of a CSV with columns of frequency, gain, phase, and perhaps their sigmas.  Raises FormatError."""
    header, rows = read_table(path)

    def values(wanted: tuple[str, ...], absent: np.ndarray | None = None) -> np.ndarray:
        if (number := _column(header, wanted)) is not None:
            return numbers_in(path, header, rows, number)
        if absent is not None:
            return absent
        raise FormatError(
            f"{path}: no column {wanted[0]} among {', '.join(map(printable, header))[:200]}; expected frequency_hz,gain,phase_deg"
        )

    f, gain, phase = map(values, (FREQUENCY, GAIN, PHASE))
    for what, numbers, most in (("frequency", f, MOST_HZ), ("gain", gain, MOST_GAIN)):
        if ((numbers < 1 / most) | (numbers > most)).any():
            raise FormatError(f"{path}: a {what} is not between {1 / most:g} and {most:g}; correct the row, or leave it out")
    gain_sigma, phase_sigma = (values((name,), np.zeros(len(f))) for name in ("gain_sigma", "phase_sigma_deg"))
    gain_sigma = np.where(gain_sigma > 0, gain_sigma, 1e-3 * gain)
    return Response(path.stem, f, gain, phase * DEG, gain_sigma, np.where(phase_sigma > 0, phase_sigma * DEG, 1e-3))
