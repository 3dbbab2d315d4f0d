"""Noise terms of one unit: all its rest logs and stills, one estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, gammaincc, gammaincinv

from session.base.errors import DataError
from session.base.progress import Progress, no_report
from session.base.texts import significant
from tinygc.features.noise.choice import FILTER, UNSEEN, Chosen, Search, cost, stacked, stacks_of, unit_covariance
from tinygc.features.noise.scales import TOP, Group, groups_of, knots_of, left_out, rest_of, temperature_part, unsteady
from tinygc.features.noise.summary import SECTION, RestSums, contrasts, ratios_of
from tinygc.inference.choose import ONE_SIDED
from tinygc.inference.solve import inverse
from tinygc.noise.figures import MISFIT, TERMS, AllanBand, AxisNoise, Line, NoiseFigures, SensorNoise, Term, fits_data

#: rates of logs of one unit agree to this share
SAME_RATE = 0.02
#: sigmas of a change of N that chance does not make
SHIFTED = 3.0
#: sigma of ln N without the finest level, above which nothing is learned from it
SEEN_WITHOUT = 0.3
#: sections that show a line; level of each test: this much in a hundred logs without one, over all frequencies together
FEWEST, LEVEL = 10, 0.01
#: bins of the background on either side of a line, and those next to it that hold its own power (Hann's window has 4 wide)
AROUND, NEXT = 12, 2
#: lines of a channel that are described, the strongest
MOST_LINES = 4
#: share of missing readings that is reported; values of a register in a section up to which its steps are as large as the noise
REPORTED_LOST, FEW_CODES = 1e-3, 6
#: bins of the spectrum within which two lines are one
NEAR = 4
#: frequencies of a band
LEAST_BAND = 4
#: sigmas by which a size differs from none, below which it is a limit alone
DETERMINED = 2.0
#: windows per contrast from which a group's whole covariance is tested, else its bands of frequency
ENOUGH = 3


class NoiseEstimate(NamedTuple):
    """figures, with the Allan deviations of the same data; remarks: what was left out or is to be known, one sentence each; left_out_s: the
    time that is not used."""

    figures: NoiseFigures
    remarks: list[str]
    left_out_s: float


def estimate_noise(sums: Sequence[RestSums], progress: Progress = no_report) -> NoiseEstimate:
    """Estimate the terms of one unit from all its rest logs and stills.

    Raises DataError where the rates differ, or where no rest is long enough.
    """
    sums = [each for each in sums if each.samples]
    if not sums:
        raise DataError("no readings at rest; expected a rest log or the stills of a session")
    if (lowest := min(each.rate_hz for each in sums)) * (1 + SAME_RATE) < (highest := max(each.rate_hz for each in sums)):
        raise DataError(f"the data rates differ, {lowest:g} and {highest:g} Hz; one estimate takes the logs of one unit at one rate")
    steps = sum(each.duration_s / each.period_s for each in sums)
    period_s = sum(each.duration_s for each in sums) / steps if steps else 1 / sums[0].rate_hz
    rests = [rest_of(each) for each in sums]
    knots = knots_of(rests)
    general = [*_missing(sums), *left_out(rests)]
    of_axes: dict[str, list[str]] = {}
    axes: list[AxisNoise | None] = []
    bands: list[list[tuple[float, float, float, float]]] = []
    dead: dict[str, list[str]] = {"gyro": [], "accel": []}
    sections = np.concatenate([each.sections for each in sums])
    for channel in range(6):
        kind, axis = ("gyro", "accel")[channel // 3], "xyz"[channel % 3]
        progress(f"{kind} {axis}", channel, 6)
        residuals, columns, moved = temperature_part(rests, channel, knots)
        groups = groups_of(rests, channel, residuals, columns)
        if not groups or not all(np.isfinite(group.S).all() for group in groups) or not any(group.S.any() for group in groups):
            dead[kind].append(axis)
            axes.append(None)
            bands.append([])
            continue
        remarks = _coarse_steps(sections[:, :, channel])
        found = _axis(groups, period_s, _lines_hz(sections[:, :, channel], period_s))
        slow = [found.terms[name] for name in "BK"]
        if any(term.chosen for term in slow) and not any(term.is_determined for term in slow):
            remarks.append("slow noise, and the rest does not separate B from K: both are limits.")
        if moved > found.value("B") > 0:
            term = found.terms["B"]
            assert term.sigma is not None
            limited = replace(term, at_most=term.at_most or term.value + ONE_SIDED * term.sigma)
            found = replace(found, terms={**found.terms, "B": limited})
        axes.append(found)
        bands.append(_allan_points(groups, period_s, found))
        remarks += unsteady(rests, channel, residuals, period_s)
        if moved:
            less = "; B is a limit, with the error of that correction" if found.value("B") else ""
            remarks.append(f"temperature moves it by {_shown(moved, kind)} rms, corrected{less}.")
        for remark in remarks:
            of_axes.setdefault(remark, []).append(f"{kind} {axis}")
    general += [f"{', '.join(names)}: {remark}" for remark, names in of_axes.items()]
    if dead["gyro"]:
        which = "" if len(dead["gyro"]) == 3 else f" of gyroscope axis {' '.join(dead['gyro'])}"
        raise DataError(f"too few readings at rest{which}, or readings that do not change; expected seconds of a sensor's noise")
    has_accel = not dead["accel"]
    if dead["accel"] and len(dead["accel"]) < 3:
        general.append(f"accel {' '.join(dead['accel'])}: its readings do not change; there are no figures of the accelerometer.")
    figures = NoiseFigures(
        allan={"gyro": _band(bands[:3])} | ({"accel": _band(bands[3:])} if has_accel else {}),
        gyro=_sensor(axes[:3]),
        accel=_sensor(axes[3:]) if has_accel else None,
        rate_hz=1 / period_s,
        duration_s=sum(each.duration_s for each in sums),
        samples=sum(each.samples for each in sums),
    )
    return NoiseEstimate(figures, general, sum(rest.left_out_s for rest in rests))


def _sensor(axes: Sequence[AxisNoise | None]) -> SensorNoise:
    x, y, z = (axis for axis in axes if axis is not None)
    return SensorNoise((x, y, z))


def _missing(sums: Sequence[RestSums]) -> list[str]:
    lost = max(each.lost for each in sums)
    if lost < REPORTED_LOST:
        return []
    return [f"{100 * lost / (1 + lost):.2g} % of the readings are missing between the stamps: slow times are too short by as much."]


def _coarse_steps(sections: np.ndarray) -> list[str]:
    """Remark where a register has few steps: rounding to them is then noise of its own, as large as the zero between two steps makes it."""
    codes = int(np.median([len(np.unique(section)) for section in sections])) if len(sections) else FEW_CODES + 1
    return (
        [f"its register moves over {codes} steps alone: N is that of the rounding, and changes with the zero."]
        if codes <= FEW_CODES
        else []
    )


def _shown(size: float, kind: str) -> str:
    return f"{significant(np.degrees(size) * 1e3, 2)} mdps" if kind == "gyro" else f"{significant(size / 9.80665e-3, 2)} mg"


# One axis.


def fitted(search_from: Callable[[int], Search], from_s: Sequence[float]) -> AxisNoise:
    """Estimate the terms from all scales that the model describes; search_from: makes a search from a scale on, of those that begin at
    averaging times from_s (K,) s, the first at 0.

    The finest scale is left out, and the next is tried, where the model misfits, or where N changes without it by more than chance (Hausman
    1978): a misfit too small for chi-square may still shift N.  Where N changes at each, the finest scale without a misfit counts, and the
    sigma of N contains the change.
    """
    fits: list[tuple[Search, Chosen, float, float, float, float]] = []
    for start, begins_s in enumerate(from_s):
        search = search_from(start)
        chosen = search.best()
        if fits and chosen.log_sigma("N") > SEEN_WITHOUT:
            continue
        p_value, excess = goodness(search, chosen)
        change, sigma = (0.0, 0.0) if start + 1 == len(from_s) else _change(chosen, search_from(start + 1))
        steady = abs(change) <= SHIFTED * sigma
        fits.append((search, chosen, p_value, excess, begins_s, 0.0 if steady else change))
        if fits_data(p_value, excess) and steady:
            return described(*fits[-1])
    return described(*next((each for each in fits if fits_data(*each[2:4])), min(fits, key=lambda each: each[3])))


def _axis(groups: list[Group], period_s: float, lines_hz: tuple[float, ...]) -> AxisNoise:
    """Estimate the terms of one axis of rests."""
    sizes = sorted({group.size for group in groups})

    def search_from(start: int) -> Search:
        return Search([group for group in groups if group.size >= sizes[start]], period_s, lines_hz, is_behind_filter=start > 0)

    return fitted(search_from, [0.0, *(size * period_s for size in sizes[1:])])


def _change(chosen: Chosen, without: Search) -> tuple[float, float]:
    """Return the change of ln N where the finest level is left out, and its sigma by chance; none where N is not seen without it."""
    terms = frozenset(chosen.names) & frozenset(without.candidates)
    other = without.of(terms, chosen) or without.of(terms - {"Q"}, chosen)
    if other is None or other.log_sigma("N") > SEEN_WITHOUT:
        return 0.0, 0.0
    change = float(np.log(other.variance("N") / chosen.variance("N"))) / 2
    return change, float(np.sqrt(max(other.log_sigma("N") ** 2 - chosen.log_sigma("N") ** 2, 0.0)))


def goodness(search: Search, chosen: Chosen) -> tuple[float, float]:
    """Return the probability of a misfit as large by chance, and chi-square over its degrees of freedom, 1 at least.

    A group's covariance is tested against the model's by the likelihood ratio with Bartlett's factor (Anderson 2003, 10.8).  The coarsest
    vector is one draw: the variances of its bands of frequency are tested against the model's.
    """
    total, freedom = 0.0, 0.0
    for stack, C in zip(search.stacks, search.covariance(chosen), strict=True):
        for S, n, which, own in zip(*stack, C, strict=True):
            d = len(S)
            if n >= ENOUGH * d:
                R = np.linalg.solve(own, S) / n
                bartlett = 1 - (2 * d + 1 - 2 / (d + 1)) / (6 * n)
                total += bartlett * n * (float(np.trace(R)) - float(np.linalg.slogdet(R)[1]) - d)
                freedom += d * (d + 1) / 2
            else:
                bands = _bands(search.groups[which].basis, S, own)
                total += sum(n * len(band) * (band.mean() / n - 1 - np.log(band.mean() / n)) for band in bands)
                freedom += len(bands)
    freedom = max(freedom - len(chosen.names) - ("G" in chosen.names), 1.0)
    return float(chdtrc(freedom, total)), max(total / freedom, 1.0)


def _bands(basis: np.ndarray, S: np.ndarray, C: np.ndarray) -> list[np.ndarray]:
    """Return the powers of a whitened vector, 1 being expected of each, in bands of frequency: octaves, the highest first."""
    values, vectors = np.linalg.eigh(C)
    whitened = basis @ (vectors / np.sqrt(np.maximum(values, 1e-300 + 1e-12 * values[-1]))) @ vectors.T
    power = np.einsum("ki,ij,kj->k", *(rows := contrasts(len(basis)).T @ whitened, S, rows))
    edges = [len(power)]
    while edges[-1] >= 2 * LEAST_BAND:
        edges.append(max(edges[-1] // 2, LEAST_BAND))
    return [power[low:high] for high, low in pairwise([*edges, 0])]


def described(search: Search, chosen: Chosen, p_value: float, excess: float, from_s: float, change: float) -> AxisNoise:
    """Return an axis' record: sizes, sigmas, wider where the model does not describe the data, limits and probabilities.

    change: of ln N, beyond chance, where the finest level is left out.
    """
    wider = np.sqrt(excess) if p_value < MISFIT else 1.0
    terms = {}
    for name in TERMS:
        probability = 1.0 if name == "N" else search.probability(name)
        value, sigma = search.average(name, wider)
        if name not in chosen.names:
            none = name == "G" or (name == "Q" and FILTER in chosen.names)  # a filter hides any quantisation
            terms[name] = Term(0.0, None, probability, None if none else max(search.limit(chosen, name), value + ONE_SIDED * sigma))
            continue
        if name == "R" and sum(group.count for group in search.groups if group.top) == 1:
            value, sigma = _slope(search, chosen)
            sigma *= wider
        if name == "N":
            sigma = float(np.hypot(sigma, value * change))
        terms[name] = Term(value, sigma, probability, value + ONE_SIDED * sigma if DETERMINED * sigma > value else None)
        if name == "G":
            time, of_log = chosen.fitted.correlation_s, float(np.sqrt(chosen.fitted.covariance[-1, -1]))
            terms[name] = replace(terms[name], tau_s=time, tau_sigma_s=time * of_log * wider)
    lines = [(f"line{k}", hz) for k, hz in enumerate(search.lines_hz)]
    seen = tuple(Line(hz, float(np.sqrt(chosen.variance(name)))) for name, hz in lines if chosen.log_sigma(name) < UNSEEN)
    return AxisNoise(terms, seen, p_value, excess, from_s)


def _slope(search: Search, chosen: Chosen) -> tuple[float, float]:
    """Return the size of a ramp and its sigma, by least squares in the coarsest vector with the noise of the other terms: one slope has no
    variance."""
    square, information = 0.0, 0.0
    without = replace(chosen.fitted, x=chosen.fitted.x * (np.array(chosen.names) != "R"))
    covariance = search.covariance(replace(chosen, fitted=without))
    for stack, C in zip(search.stacks, covariance, strict=True):
        for S, _, which, own in zip(*stack, C, strict=True):
            group = search.groups[which]
            if group.top:
                t = group.t() * group.size * search.period_s
                w = np.linalg.solve(own, t)
                information += float(t @ w)
                square += float(w @ S @ w)
    return float(np.sqrt(square)) / information, float(1 / np.sqrt(information))


# Lines: peaks of the mean periodogram.  White noise and the sensor's own 1/f noise have none.


def _lines_hz(sections: np.ndarray, period_s: float) -> tuple[float, ...]:
    """Frequencies of the strongest lines of an axis, of sections (K, SECTION)."""
    moving = sections[np.ptp(sections, axis=1) > 0]
    if len(moving) < FEWEST:
        return ()
    # Without their lines through the ends' means, in Hann's window.
    t = np.arange(SECTION) - (SECTION - 1) / 2
    x = moving - moving.mean(axis=1, keepdims=True)
    x = x - t * (x @ (t / (t @ t)))[:, None]
    hz = np.fft.rfftfreq(SECTION, period_s)
    power = np.mean(np.abs(np.fft.rfft(x * np.hanning(SECTION + 1)[:-1], axis=1)) ** 2, axis=0)
    apart: list[int] = []
    for at in _peaks(power, len(moving)):
        if all(abs(at - other) > NEAR for other in apart):
            apart.append(at)
    size = np.sqrt(power)
    found = []
    for at in apart[:MOST_LINES]:  # between two bins, by the ratio of their amplitudes in Hann's window
        side = 1 if size[at + 1] > size[at - 1] else -1
        ratio = size[at + side] / size[at]
        found.append(float((at + side * np.clip((2 * ratio - 1) / (ratio + 1), 0, 0.5)) * hz[1]))
    return tuple(found)


def _peaks(power: np.ndarray, count: int) -> list[int]:
    """Bins of a mean periodogram (F,) of so many sections, the strongest first, that chance makes of their surroundings in less than one
    log of a hundred."""
    middle = gammaincinv(count, 0.5) / count  # the median of a mean periodogram, of its mean
    found = []
    for k in range(2, len(power) - 1):
        low, high = max(k - AROUND, 1), min(k + AROUND + 1, len(power) - 1)
        near = np.r_[low : max(k - NEXT, low), min(k + NEXT + 1, high) : high]
        if len(near) < AROUND or power[k] < power[max(k - NEXT, 0) : k + NEXT + 1].max():
            continue
        if len(power) * gammaincc(count, count * power[k] * middle / np.median(power[near])) < LEVEL:
            found.append((power[k], k))
    return [k for _, k in sorted(found, reverse=True)]


# The Allan deviation, of the same windows.


def _allan_points(groups: Sequence[Group], period_s: float, axis: AxisNoise) -> list[tuple[float, float, float, float]]:
    """Return averaging time, deviation and its 68 % bounds at powers of two of each scale.

    Differences of neighbouring means overlap within a window and do not cross its ends.  The variance of their mean square is that of a
    quadratic form in Gaussian contrasts, with the data's own covariance where windows are many, else the fitted one.
    """
    found: dict[float, tuple[float, float]] = {}
    for group in groups:
        count = len(group.at)
        for k in 2 ** np.arange(int(np.log2(count))):
            A = _mean_square(group, int(k))
            if A is None:
                continue
            mean = float(np.sum(A * group.S)) / group.count
            C = group.S / group.count if group.count >= ENOUGH * len(group.S) else _model(group, period_s, axis)
            AC = A @ C
            # The trace of AC AC is positive but for rounding.
            sigma = np.sqrt(max(2 * float(np.sum(AC * AC.T)) / group.count, 1e-30)) / max(float(np.trace(AC)), 1e-300)
            tau_s = group.size * int(k) * period_s
            weight = 1 / sigma**2
            before = found.get(tau_s, (0.0, 0.0))
            found[tau_s] = (before[0] + weight * mean, before[1] + weight)
    points = []
    for tau_s, (total, weight) in sorted(found.items()):
        square, relative = total / weight, 1 / np.sqrt(weight)
        freedom = 2 / relative**2  # of a chi-square with this relative sigma
        low, high = (np.sqrt(square * freedom / (2 * gammaincinv(freedom / 2, p))) for p in (0.84, 0.16))
        points.append((tau_s, float(np.sqrt(square)), float(low), float(high)))
    return points


def _mean_square(group: Group, k: int) -> np.ndarray | None:
    """Return A (d, d): z' A z is half the mean square of differences between neighbouring means of k; None where no pair has all means."""
    place = np.full(int(group.at[-1]) + 1, -1)
    place[group.at] = np.arange(len(group.at))
    rows = []
    for start in range(len(place) - 2 * k + 1):
        pair = place[start : start + 2 * k]
        if (pair >= 0).all():
            row = np.zeros(len(group.at))
            row[pair] = np.repeat([-1 / k, 1 / k], k)
            rows.append(row)
    if not rows:
        return None
    D = np.array(rows) @ group.basis
    return D.T @ D / (2 * len(rows))


def _model(group: Group, period_s: float, axis: AxisNoise) -> np.ndarray:
    total = np.zeros((group.basis.shape[1],) * 2)
    for name, term in axis.terms.items():
        if term.value:
            total = total + term.mean_square * unit_covariance(name, [group], period_s, term.tau_s or 1.0)[0]
    return total


def _band(axes: Sequence[list[tuple[float, float, float, float]]]) -> AllanBand:
    tau_s = sorted({point[0] for points in axes for point in points})
    table = np.full((len(tau_s), 3, 3), np.nan)
    for axis, points in enumerate(axes):
        for tau, *values in points:
            table[tau_s.index(tau), axis] = values
    return AllanBand(np.array(tau_s), table[..., 0], table[..., 1], table[..., 2])


# How long to record.


def known_after_s(figures: NoiseFigures, kind: str, axis: int, name: str, relative: float = 0.2) -> float:
    """Duration of rest, s, after which a term (of its present size, or of its limit) is known to a relative sigma; inf where never.

    From the expected information of a rest of that length, with all terms that the axis shows; its sigma counts as much more, or less,
    as that which is stated now exceeds what these figures' own length lets expect.
    """
    own = figures.sensors()[kind].axes[axis]
    terms = {key: (term.value, term.tau_s) for key, term in own.terms.items() if term.chosen}
    if name in terms and not own.terms[name].is_determined and terms[name][0] > DETERMINED * (own.terms[name].sigma or 0.0):
        return float("inf")  # what limits it is temperature, and no length of rest
    if name not in terms:
        if not own.terms[name].at_most:
            return float("inf")
        terms[name] = (float(own.terms[name].at_most or 0.0), None)
    period_s, first, sizes = 1 / figures.rate_hz, max(own.from_s, 0.0), tuple((key, *found) for key, found in terms.items())
    if (stated := own.terms[name]).sigma is not None:
        expected = _relative(sizes, name, figures.duration_s, period_s, first)
        relative *= expected * stated.value / stated.sigma if 0 < expected < np.inf else 1.0
    low, high = np.log(10.0), np.log(LONGEST_S)
    if _relative(sizes, name, float(np.exp(high)), period_s, first) > relative:
        return float("inf")
    while high - low > 0.02:
        middle = (low + high) / 2
        low, high = (low, middle) if _relative(sizes, name, float(np.exp(middle)), period_s, first) <= relative else (middle, high)
    return float(np.exp(high))


#: s: a year is not recorded
LONGEST_S = 3.2e7


@lru_cache(1 << 10)
def _relative(terms: tuple[tuple[str, float, float | None], ...], name: str, duration_s: float, period_s: float, from_s: float) -> float:
    """Expected sigma of ln s of a term in a rest of a duration; terms: name, size, and correlation time."""
    block = RestSums(1 / period_s)
    shapes, size, left = [], 1, duration_s / period_s
    ratios = list(ratios_of(block.size))
    while left > TOP:
        ratio = ratios.pop(0) if ratios else 8
        left /= ratio
        shapes.append((size, ratio, left))
        size *= ratio
    count = max(int(left), 2)
    groups = [Group(s, np.arange(r), contrasts(r), np.zeros((r - 1, r - 1)), n) for s, r, n in shapes if s * period_s >= from_s * 0.99]
    groups.append(Group(size, np.arange(count), contrasts(count), np.zeros((count - 1,) * 2), 1.0, top=True))
    names = [key for key, _, _ in terms]
    stacks = stacks_of(groups)
    V = [stacked(unit_covariance(key, groups, period_s, time_s or 1.0), stacks) for key, _, time_s in terms]
    x = np.array([size**2 for _, size, _ in terms])
    _, _, curvature = cost(x, V, stacks)
    information = curvature * np.outer(x, x) / 2
    return float(np.sqrt(inverse(information)[names.index(name), names.index(name)]) / 2)
