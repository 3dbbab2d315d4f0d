"""What a filter with white noise and a random walk needs of a sensor: its two densities, and how each is known.

Densities are two-sided, as in IEEE 952, Kalibr, OpenVINS and GTSAM: white noise of density N has the Allan deviation N / sqrt(tau), a walk
of density K has K sqrt(tau / 3).  A step of dt seconds adds N^2 dt to the variance of an angle or a velocity, and K^2 dt to that of a bias.

K of an axis is, in this order: the measured one; where B or G show and K does not, the walk that has their Allan deviation at ``WALK_S``;
the upper limit that the log sets.  Without figures N is that of the stills, and K is guessed from a bias instability.

An axis whose data the terms do not describe has no density: the worst of the others stands for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from session.base.texts import command_line, probability, shell_word
from session.base.units import DEG, DEG_PER_HOUR, G
from tinygc.deploy import ExportError
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import words
from tinygc.noise.figures import FILE, NAMES, SENSORS, TERMS, AxisNoise, Inflation, described_from

#: s: the walk that stands for a flicker floor has the floor's Allan deviation at this averaging time.  A choice: the time over which a
#: filter that is corrected by vision or satellites follows a bias; a longer one gives a smaller walk
WALK_S = 100.0
#: Allan deviation of the floor, as a share of the bias instability: sqrt(2 ln 2 / pi)
FLOOR = 0.664
#: m/s^2, assumed for a MEMS accelerometer of this class: not measured
ACCEL_INSTABILITY_MPS2 = 4e-4
MEASURED = "measured"
OF_STILLS = "measured in the stills"
FROM_FLOOR = f"from the flicker floor at {WALK_S:g} s"
LIMIT = "UPPER LIMIT (95 %), NOT MEASURED"
GUESSED = "GUESSED, NOT MEASURED"
INFLATED = "with the slow terms, in motion"
IN_MOTION_ALONE = f"{INFLATED}; no log at rest shows it"
UNKNOWN = "not known"
MOTION = "Vibration, temperature and scale error in motion are in none of these: 5 to 10 times as much is usual in filters."
#: sources of what a log shows
SHOWN = (MEASURED, OF_STILLS, FROM_FLOOR, INFLATED)
REPLACED = "NOT DESCRIBED: the worst axis stands for it"
UNITS = {"gyro": ("rad/s/sqrt(Hz)", "rad/s^2/sqrt(Hz)"), "accel": ("m/s^2/sqrt(Hz)", "m/s^3/sqrt(Hz)")}


@dataclass(frozen=True, eq=False)
class Density:
    """values (3,) SI of the axes x, y, z, NaN where nothing is known; sigmas (3,), NaN where not measured; sources: how each is known."""

    values: np.ndarray
    sigmas: np.ndarray
    sources: tuple[str, ...]

    @property
    def known(self) -> bool:
        """Whether any axis has a value."""
        return bool(np.isfinite(self.values).any())

    @property
    def worst(self) -> int:
        """The axis with the largest value, of those that show one; an upper limit counts where no axis does."""
        shown = [source in SHOWN for source in self.sources]
        return int(np.nanargmax(np.where(shown, self.values, np.nan) if any(shown) else self.values))

    @property
    def largest(self) -> float:
        """The value of the worst axis."""
        return float(self.values[self.worst])

    @property
    def source(self) -> str:
        """How the value of the worst axis is known."""
        return self.sources[self.worst]

    @property
    def each(self) -> np.ndarray:
        """(3,) SI: the value of each axis, that of the worst one where nothing is known."""
        return np.where(np.isnan(self.values), self.largest, self.values)

    def times(self, factors: np.ndarray) -> Density:
        """The density with a factor (3,) on each axis."""
        return Density(self.values * factors, self.sigmas * factors, self.sources)

    def __str__(self) -> str:
        sigmas = ["" if np.isnan(sigma) else f" +- {sigma:.2g}" for sigma in self.sigmas]
        known = zip(self.values, sigmas, self.sources, strict=True)
        return "; ".join(source if np.isnan(value) else f"{value:.4g}{sigma} {source}" for value, sigma, source in known)


NOTHING = Density(np.full(3, np.nan), np.full(3, np.nan), (UNKNOWN,) * 3)


@dataclass(frozen=True, eq=False)
class Densities:
    """Of one sensor: white, N; walk, K, or ``NOTHING`` for a format without it."""

    white: Density
    walk: Density


def densities(
    context: Context, name: str, needed: Iterable[str] = tuple(SENSORS), walks: bool = True, of_rate: bool = False
) -> dict[str, Densities]:
    """Densities by ``gyro`` and ``accel``, with the inflation of the context; name: of the format; walks: whether it has random walks;
    of_rate: whether its numbers depend on the data rate.

    Reports what a person should know before he uses them: axes that are left out, guesses and limits.  Raises ExportError where a sensor
    that is needed has none.
    """
    for line in _left_out(context):
        context.remark(f"{name}: {line}")
    found = {}
    measured = {} if context.noise is None else context.noise.sensors()
    for kind in SENSORS:
        white, walk = _density(context, kind, "N"), _density(context, kind, "K") if walks else NOTHING
        if white is not None and walk is not None:
            found[kind] = Densities(white, walk)
        elif kind in needed and kind in measured and not any(axis.is_described for axis in measured[kind].axes):
            chances = ", ".join(probability(axis.p_value) for axis in measured[kind].axes)
            stills = f", or move {FILE} away to export the noise of the stills" if context.fit.get("noise") else ""
            raise ExportError(
                f"{name} needs the noise of the {SENSORS[kind]}, and the terms describe none of its axes ({chances}): record "
                f"again away from what shakes or warms it{stills}"
            )
        elif kind in needed and white is None:
            raise ExportError(
                f"{name} needs the noise of the {SENSORS[kind]}: measure it on a log at rest, or "
                f"`{command_line('fit')}`, whose fit.json next to the model holds that of the stills"
            )
        elif kind in needed:
            raise ExportError(
                f"{name} needs a bias instability, since no log shows the {SENSORS[kind]}'s random walk: "
                "give sensor.gyro_bias_instability_dph in session.toml, or measure the noise on a longer log at rest"
            )
    if context.inflation is not None:
        found["gyro"] = _inflated(found["gyro"], context.inflation)
    for line in _doubts(context, found, of_rate):
        context.remark(f"{name}: {line}")
    return found


def _doubts(context: Context, found: Mapping[str, Densities], of_rate: bool) -> Iterable[str]:
    """A line for each guess and limit."""
    if context.noise is None and any(both.walk.known for both in found.values()):
        yield "the random walks are guesses from bias instability; minutes of recording do not show them"
    for kind, both in found.items() if context.noise is not None else ():
        for what, density in (("white noise", both.white), ("random walk", both.walk)):
            if density.known and density.source in (LIMIT, GUESSED):
                known = "an upper limit (95 %)" if density.source == LIMIT else "guessed"
                yield f"the {SENSORS[kind]}'s {what} is {known}: the log at rest does not show it"
    if of_rate and not context.rate_known:
        rate = f"{context.config.sensor.odr_hz:.6g} Hz"
        guess = "is a guess, 1 over the shortest averaging time of a curve"
        yield f"its data rate, {rate}, {guess}; measure the noise again with --odr"


def _inflated(plain: Densities, motion: Inflation) -> Densities:
    """The gyroscope's densities on a kind of motion: N and K times its factors; K is the motion's own walk where that is larger.

    No K becomes smaller, be it a limit.
    """
    white, walk = plain.white.times(motion.white), plain.walk
    if motion.walk_density is None or not walk.known:
        return Densities(white, walk.times(np.maximum(motion.walk, 1.0)))
    own = motion.walk_density > np.nan_to_num(walk.values)
    # Next to limits alone it outweighs none of them as what a log shows would.
    named = INFLATED if walk.source in SHOWN else IN_MOTION_ALONE
    sources = tuple(named if is_own else source for is_own, source in zip(own, walk.sources, strict=True))
    return Densities(white, Density(np.where(own, motion.walk_density, walk.values), np.where(own, np.nan, walk.sigmas), sources))


def _density(context: Context, kind: str, term: str) -> Density | None:
    """N or K of a sensor: from the figures, else of the fit's stills and of a bias instability; None where nothing is known, and where the
    figures describe no axis."""
    sensor = None if context.noise is None else context.noise.sensors().get(kind)
    if sensor is not None:
        values, sigmas, sources = zip(*(_of_axis(axis, term) for axis in sensor.axes), strict=True)
        if np.isfinite(values).any():
            return Density(np.array(values), np.array(sigmas), sources)
        if not any(axis.is_described for axis in sensor.axes):
            return None
    unknown = np.full(3, np.nan)
    if term == "N":
        name, unit = {"gyro": ("gyro_dps_rthz", DEG), "accel": ("accel_g_rthz", G)}[kind]
        one_sided = context.fit.get("noise", {}).get(name)
        return None if one_sided is None else Density(np.multiply(one_sided, unit) / np.sqrt(2), unknown, (OF_STILLS,) * 3)
    guess = context.gyro_instability if kind == "gyro" else (ACCEL_INSTABILITY_MPS2, "")
    return None if guess is None else Density(np.full(3, np.sqrt(3 / WALK_S) * FLOOR * guess[0]), unknown, (GUESSED,) * 3)


def _of_axis(axis: AxisNoise, name: str) -> tuple[float, float, str]:
    """Value, sigma and source of N or K of one axis."""
    if not axis.is_described:
        return np.nan, np.nan, REPLACED
    term = axis.terms[name]
    if term.sigma is not None and term.is_determined and term.value > 0:
        return term.value, term.sigma, MEASURED
    if name == "K":
        at = np.array([WALK_S])
        floor = sum(float(axis.allan_variance(at, slow)[0]) for slow in "BG")
        if floor > 0:
            return float(np.sqrt(3 * floor / WALK_S)), np.nan, FROM_FLOOR
    if term.at_most:
        return term.at_most, np.nan, LIMIT
    return np.nan, np.nan, UNKNOWN


def _left_out(context: Context) -> list[str]:
    """One line for each axis whose data the terms do not describe."""
    sensors = {} if context.noise is None else context.noise.sensors()
    return [
        f"{SENSORS[kind]} {name}: the terms do not describe its data ({probability(axis.p_value)}): left out"
        for kind, sensor in sensors.items()
        for name, axis in zip("xyz", sensor.axes, strict=True)
        if not axis.is_described
    ]


def kalibr_keys(found: Mapping[str, Densities]) -> tuple[dict[str, float], dict[str, str]]:
    """Kalibr's four keys, which OpenVINS shares, with the values of the worst axes, and a comment for each: unit, and how it is known."""
    values: dict[str, float] = {}
    sources: dict[str, str] = {}
    for kind, both in found.items():
        for ending, density, unit in zip(("noise_density", "random_walk"), (both.white, both.walk), UNITS[kind], strict=True):
            values[f"{SENSORS[kind]}_{ending}"] = density.largest
            sources[f"{SENSORS[kind]}_{ending}"] = f"{unit}, {density.source}"
    return values, sources


def noise_remarks(context: Context, found: Mapping[str, Densities]) -> tuple[str, ...]:
    """Lines for a file's head: densities of all axes with their sigmas, how they are known, what they leave out, and inflations."""
    figures = context.noise
    if figures is None:
        return _remarks_of_stills(context, found)
    rate = f"{figures.rate_hz:.6g} Hz{'' if figures.rate_known else ' (a guess)'}"
    lines = [
        f"Noise at rest, {figures.duration_s / 3600:.3g} h at {rate}, of x; y; z:",
        "two-sided densities, whose Allan deviation is sigma(tau) = N / sqrt(tau) and K sqrt(tau / 3).",
    ]
    for kind, both in found.items():
        own = UNITS[kind]
        lines.append(f"{SENSORS[kind]} N {both.white} [{own[0]}]")
        if both.walk.known:
            lines.append(f"{SENSORS[kind]} K {both.walk} [{own[1]}]")
    sources = {source for both in found.values() for source in (*both.white.sources, *both.walk.sources)}
    if FROM_FLOOR in sources:
        lines.append(
            "K from the flicker floor: a filter with N and K alone has no flicker.  That walk has the Allan deviation of B and G at "
            f"{WALK_S:g} s.  The time is a choice: K goes as 1 / sqrt of it."
        )
    if LIMIT in sources:
        lines.append("An upper limit is what the log does not exclude.  The true value may be zero: a longer log at rest shows more.")
    if GUESSED in sources:
        lines.append("What is guessed has no log behind it: replace it by a log at rest.")
    lines += [*_left_out(context), *described_from(figures)]
    axes = [axis for sensor in figures.sensors().values() for axis in sensor.axes if axis.is_described]
    apart = [f"{name} ({NAMES[name]})" for name in TERMS if name not in "NK" and any(axis.terms[name].is_determined for axis in axes)]
    apart += ["lines of the spectrum"] * any(axis.lines for axis in axes)
    if apart:
        lines.append(f"Measured, and not in this format: {', '.join(apart)}.")
    return (*lines, *_inflations(context))


def _remarks_of_stills(context: Context, found: Mapping[str, Densities]) -> tuple[str, ...]:
    gyro, accel = (found[kind].white.values for kind in SENSORS)
    instability, source = context.gyro_instability or (np.nan, "")
    text = f" (the gyroscope's: {source})" if not source.startswith("typical") else ""
    return (
        "Densities are sigma_continuous = sigma_sample * sqrt(dt), measured in the stills; the worst axis is given:",
        f"gyroscope {words(gyro)}, accelerometer {words(accel)} (x, y, z).",
        f"Random walks are NOT MEASURED: they have the Allan deviation at {WALK_S:g} s of bias instabilities of "
        f"{instability / DEG_PER_HOUR:.4g} deg/h and {ACCEL_INSTABILITY_MPS2:g} m/s^2{text}.",
        f"Measured ones: record an hour at rest, `{command_line('noise', 'LOG.csv')}`, then export again with --noise.",
        f"The densities are of a sensor at rest.  {MOTION}",
    )


def _inflations(context: Context) -> list[str]:
    """Lines on the factors that motion asks for, and whether they are in the densities."""
    if context.noise is None or not context.noise.inflations:
        return [MOTION]
    if not context.noise.gyro.is_described:
        return ["The factors of the figures for motion are not used: they are to N at rest, and an axis of it is not described."]
    lines = ["In motion the gyroscope's densities are to be larger (x, y, z); the accelerometer's factors are not known:"]
    for each in context.noise.inflations:
        used = "IN THE VALUES BELOW" if each is context.inflation else f"not in them; --inflation {shell_word(each.motion)} puts them in"
        source = f" ({each.source})" if each.source else ""
        walk = f"K x {_factors(each.walk)}"
        if each.walk_density is not None:
            walk = f"K {_factors(each.walk_density)}" if each.walk_density.any() else "K as at rest"
        lines.append(f"{each.motion}{source}: N x {_factors(each.white)}, {walk}: {used}")
    return lines


def _factors(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
