"""Write an explanation as ``tinygc-explain/2`` (docs/formats.md): location, residuals, candidates considered, what to record next."""

from __future__ import annotations

from typing import Any

import numpy as np

from session import VERSION
from session.base.numeric import rms_of
from session.base.records import plain, table_of
from session.base.texts import measured
from session.base.units import DEG, G
from session.log.folder import file_key, hash_of_log
from session.log.samples import pieces, start_times
from tinygc.effects import catalogue
from tinygc.effects.effect import IN_STILLS, LEVEL, ROWS, SECONDS
from tinygc.explanation.claims import CHANNELS, LEFT, Claim, p_entry
from tinygc.explanation.decision import tilt_rms
from tinygc.explanation.engine import Explanation
from tinygc.explanation.families import SlowZero, slow_zero
from tinygc.explanation.search import lines_end_hz
from tinygc.noise.channels import own_residuals, unknown_rows
from tinygc.noise.twin import Variable, variable_of
from tinygc.verdict.model_tests import EARTH_ROTATION, EARTH_SHOWS

# Times, in seconds of the session, of what was found in the registers and in the stills.


def moments_s(e: Explanation, claim: Claim) -> np.ndarray | None:
    """(K,) times of an effect that occurs at moments, at least two for a span; None for any other effect."""
    occurs = claim.effect.occurs
    if occurs is None:
        return None
    if occurs.counts == LEVEL:
        return clipped_readings(e, claim)[0]
    if occurs.counts == ROWS:
        return reading_s(e, np.array(claim.parameters[occurs.key], dtype=int))
    if occurs.counts == SECONDS:
        return np.array(claim.parameters[occurs.key], dtype=float)
    if occurs.counts == IN_STILLS:
        began = e.problem.began_s
        spans = [(began[i] + s.start_s, began[i] + s.start_s + s.duration_s) for i, log in enumerate(e.problem.logs) for s in log.stills]
        return np.ravel([spans[number] for number in claim.parameters[occurs.key]])
    raise ValueError(f"{claim.effect.id}: occurs counts {occurs.counts!r}")


def clipped_readings(e: Explanation, claim: Claim) -> tuple[np.ndarray, np.ndarray]:
    """All readings at the level of a clipping claim: seconds of the session (K,), and magnitude (K,), rad/s."""
    assert claim.effect.occurs is not None
    key = claim.effect.occurs.key
    level = claim.parameters[key] * DEG
    magnitude = np.concatenate([np.abs(part).max(axis=1) for log in e.session.logs for _, part in pieces(log.samples.gyro)])
    rows = np.flatnonzero(magnitude >= level - claim.std[key] * DEG)
    return reading_s(e, rows), magnitude[rows]


def reading_s(e: Explanation, rows: np.ndarray) -> np.ndarray:
    """(K,) times of rows that are counted over all logs."""
    logs = [log.samples for log in e.session.logs]
    return np.concatenate([began + samples.t_s for began, samples in zip(start_times(logs)[:-1], logs, strict=True)])[rows]


# Locate: the channels, axes, segments, times and the range of a variable in which the mismatch occurs.

#: p-value below which a channel belongs to the mismatch: 0.3 % of quiet sessions over three channels
BELONGS_P = 1e-3
#: sigmas for an axis or a segment: two angles exceed this by chance once in 3000 segments
BELONGS_SIGMAS = 4.0
MOST_SEGMENTS = 12
NOWHERE: dict[str, Any] = {"phases": [], "axes": [], "segments": [], "segment_seconds": [], "seconds": None, "conditions": None}


def where(e: Explanation) -> dict:
    """Phases, axes, segments with their seconds, the time span and the regime of the mismatch; empty if there is none."""
    if e.verdict == "no_mismatch":
        return dict(NOWHERE)
    shown = [*e.claimed, *e.findings]
    phases = {phase for claim in e.claimed for phase in claim.effect.observable_in}  # a shape without a name may be seen anywhere
    names = {"closure": "turn", "still": "still", "length": "reference"}
    phases |= {names[name] for name, (before, after) in e.own_p.items() if (after if e.claimed else before) < BELONGS_P}
    order = ("still", "turn", "reference", "timing")
    segments = worst_segments(e)
    # [from, to] of each segment, s of the session.
    began = e.problem.began_s
    at = {segment.number: segment for segment in e.problem.segments}
    spans = []
    for number in segments:
        start = float(began[at[number].log] + at[number].start_s)
        spans.append([round(start, 3), round(start + at[number].duration_s, 3)])
    strongest = next((claim for claim in shown if claim.effect.conditions), None)
    return {
        "phases": [phase for phase in order if phase in phases],
        "axes": _axes(e, shown),
        "segments": segments,
        "segment_seconds": spans,
        "seconds": _seconds(e, strongest, spans),
        "conditions": None if strongest is None else _range(e, strongest),
    }


def worst_segments(e: Explanation) -> list[int]:
    """Numbers of the segments whose closure exceeds their floor most, worst first."""
    used = [segment.number for segment in e.problem.used]
    rows = [used.index(number) for number in e.proof.before_numbers]  # a report explains segments that its fit leaves out, too
    sigma = np.sqrt(np.trace(e.problem.floor.own[rows], axis1=1, axis2=2))
    excess = np.linalg.norm(e.proof.before, axis=1) / sigma
    order = np.argsort(-excess)[:MOST_SEGMENTS]
    return [e.proof.before_numbers[i] for i in order if excess[i] > BELONGS_SIGMAS / np.sqrt(2)]


def _axes(e: Explanation, shown: list[Claim]) -> list[str]:
    """Body axes whose parameters are significant; without claims, axes whose residual rates in the stills are significant."""
    weights = np.zeros(3)
    for claim in shown:
        name = claim.effect.parameter.name
        if name not in claim.std or claim.effect.kind == "register":
            continue
        ratio = np.abs(np.ravel(claim.parameters[name])) / np.maximum(np.ravel(claim.std[name]), 1e-300)
        if ratio.size % 3 == 0:
            weights = np.maximum(weights, ratio.reshape(3, -1).max(axis=1))
    if not shown and e.twin.stills:
        part = e.whiten.parts["still"]
        rows = own_residuals(e.twin, e.whiten, e.naming.first)[0][part].reshape(-1, 3)
        weights = np.abs(rows).max(axis=0)
    return [axis for axis, weight in zip("xyz", weights, strict=True) if weight > BELONGS_SIGMAS]


def _seconds(e: Explanation, claim: Claim | None, spans: list[list[float]]) -> list[float] | None:
    """[from, to]: where the strongest effect is at least half its maximum, or from its first to its last moment."""
    if claim is None:
        return [min(start for start, _ in spans), max(stop for _, stop in spans)] if spans else None
    times = moments_s(e, claim)
    if times is None:
        t_s = np.concatenate([movement.t_s for movement in e.twin.movements])
        strong = _where_strong(e, claim)
        times = t_s if strong is None else t_s[strong]
    return [round(float(times.min()), 3), round(float(times.max()), 3)] if len(times) else None


def _range(e: Explanation, claim: Claim) -> dict | None:
    """Range of the strongest effect's variable: where the effect is at least half its maximum, or at its moments."""
    regime = variable_of(claim.effect, claim.theta)
    values = _values(e, claim, regime)
    if not len(values) or not np.isfinite(values).all():
        return None
    axis = {} if regime.axis is None else {"axis": "xyz"[regime.axis]}
    return {"variable": regime.variable, "units": regime.units, "from": float(values.min()), "to": float(values.max()), **axis}


def _values(e: Explanation, claim: Claim, regime: Variable) -> np.ndarray:
    if claim.effect.occurs is not None and claim.effect.occurs.counts == LEVEL:
        return clipped_readings(e, claim)[1] / DEG
    if regime.variable == "time" and (times := moments_s(e, claim)) is not None:
        return times
    if regime.variable == "attitude":
        return regime.of_stills(e.twin)
    by_log = [regime.of_samples(movement) for movement in e.twin.movements]
    if claim.effect.kind == "motion":  # in the used turns only
        by_log = [by_log[s.log][s.start : s.stop] for s in e.twin.segments]
    values = np.concatenate(by_log)
    strong = _where_strong(e, claim)
    return values[values > 0.5 * np.quantile(values, 0.999)] if strong is None else values[strong]


def _where_strong(e: Explanation, claim: Claim) -> np.ndarray | None:
    """Samples (N,) bool at which the effect adds at least half of its maximum; None if it adds to no rate."""
    if claim.effect.kind != "rate":
        return None
    strength = np.concatenate([np.linalg.norm(claim.effect.columns(m) @ claim.theta, axis=1) for m in e.twin.movements])
    return strength > 0.5 * np.quantile(strength, 0.999)


# Recorded minus predicted, channel by channel: one table for the terminal, the report and the JSON.

#: heading of the table
HEADING = "Recorded less predicted, in sigmas of the noise (rms; 1 is noise alone)"


def is_refitted(e: Explanation) -> bool:
    """Whether the fit has effects beyond the linear model.  Register repairs do not count: they precede both fits."""
    return bool(e.naming.fit.state.claims)


def channel_rms(e: Explanation) -> dict[str, tuple[float, float]]:
    """(before, after) of each channel by itself: rms in sigmas of its own noise, per degree of freedom.

    Each channel is whitened alone.  Joint whitening would spread a misfit of the closure over channels that have none, such as the length
    of gravity, which depends on the accelerometer only.
    """
    looks = [own_residuals(e.twin, e.whiten, fit) for fit in (e.naming.first, e.naming.fit)]
    found = {}
    for name in e.own_p:
        part = e.whiten.parts[name]
        before, after = (float(np.sqrt(np.sum(r[part] ** 2) / max(values_of(e, name) - taken[name], 1))) for r, taken in looks)
        found[name] = before, after
    return found


def values_of(e: Explanation, name: str) -> int:
    """Number of values of a channel, without the rows of angles that no reference observes."""
    part = e.whiten.parts[name]
    return part.stop - part.start - unknown_rows(e.twin, name)


def residual_table(e: Explanation) -> list[tuple[str, int, list[float]]]:
    """Rows of the table: the fitted channels, then slope and scatter within the stills, which no fitted effect changes.  Of each its name,
    the number of values, and their rms in sigmas with the linear model, then with the named effects, where a fitted effect moves them."""
    rows = []
    for name, (before, after) in channel_rms(e).items():
        rows.append((CHANNELS[name], values_of(e, name), [before, after] if is_refitted(e) else [before]))
    for name, sigmas in e.within.items():
        rows.append((f"{name} of the rate within each still", sigmas.size, [rms_of(sigmas)]))
    return rows


def needs_latitude(e: Explanation) -> bool:
    """Whether the Earth's rotation is found, or the likeliest cause of what is not explained, where no latitude is given."""
    shows = e.decision is not None and any(test.description == EARTH_SHOWS for test in e.decision.tests)
    return any(claim.effect.id == EARTH_ROTATION for claim in e.claimed) or (shows and e.verdict == "unexplained" and not e.findings)


def what_next(e: Explanation) -> str | None:
    """Motion or condition that would decide what this recording cannot; None if nothing is open."""
    for claim in e.claimed:
        if claim.equivalent:
            return claim.effect.discriminating_motion
    if e.findings:
        return e.findings[0].effect.discriminating_motion
    if e.verdict == "unexplained" and needs_latitude(e):
        return EARTH_SHOWS.partition("; ")[2]
    if e.verdict == "unexplained" and (suspicion := next((warning.do for warning in e.warnings if warning.do), None)):
        return suspicion
    if e.verdict == "unexplained":
        worst = worst_segments(e)
        where_to_look = f"; begin with the movement of segment {worst[0]}" if worst else ""
        return "repeat the session with one thing changed at a time (rate, temperature, attitude)" + where_to_look
    if e.verdict == "partly_explained" and len(e.own_p) * min(after for _, after in e.own_p.values()) < BELONGS_P:
        return "repair what is named, record again, and explain what is left"
    return None


# Rejected candidates, competing effects and the noise, in words that terminal and report share.

MOST_LISTED = 6  #: entries of each list on a page; the JSON has all
#: an effect with a lower probability is not listed
LEAST_CHANCE = 0.01


def chance_words(probability: float) -> str:
    """Format a probability: ``0.87``, ``> 0.999`` or ``< 0.001``."""
    return "> 0.999" if probability > 0.999 else "< 0.001" if probability < 0.001 else f"{probability:.3g}"


def rejected_words(e: Explanation) -> list[str]:
    """``gyro.bias_step (0.04)``: names of a size that no sensor has, the detected moments that closure rejects, which have no probability
    of their own, then the most probable rejected effects."""
    shown = sorted((each for each in e.considered if each.moments or each.probability >= LEAST_CHANCE), key=lambda each: each.moments == 0)
    reasons = [f"moments: {each.moments}" if each.moments else chance_words(each.probability) for each in shown[:MOST_LISTED]]
    refused = [f"{claim.effect.id} (of a size that no sensor has)" for claim in e.naming.refused]
    return refused + [f"{each.id} ({reason})" for each, reason in zip(shown, reasons, strict=False)]


def rival_words(claim: Claim) -> list[str]:
    """``gyro.bias_step (0.04)``: competing effects that are probable enough to list, most probable first, without the equivalent ones."""
    rivals = sorted(claim.rivals.items(), key=lambda rival: -rival[1])
    shown = [(name, chance) for name, chance in rivals if chance >= LEAST_CHANCE and name not in claim.equivalent]
    return [f"{name} ({chance_words(chance)})" for name, chance in shown[:MOST_LISTED]]


def equivalent_words(claim: Claim) -> list[str]:
    """``gyro.bias_step (0.4)``: equivalent effects, each with its probability if it was evaluated."""
    return [f"{name} ({chance_words(claim.rivals[name])})" if name in claim.rivals else name for name in claim.equivalent]


def noise_rows(e: Explanation) -> list[tuple[str, str, str]]:
    """(name, size ± sigma with its unit, description) of each noise component."""
    return [(c["name"], f"{measured(c['size'], c['sigma'])} {c['unit']}", c["description"]) for c in e.noise.to_json()]


def families_of(e: Explanation) -> list[SlowZero]:
    """Statements of families whose members this recording hardly separates."""
    slow = slow_zero(e.twin, [*e.claimed, *e.findings])
    return [slow] if slow is not None and slow.is_open else []


# An explanation as ``tinygc-explain/2`` (docs/formats.md): effects, location, certainty, and what to record next.

SCHEMA = "tinygc-explain/2"


def to_json(e: Explanation) -> dict:
    """The complete result, JSON-ready."""
    before_deg, after_deg, gravity = tilt_rms(e.proof.before) / DEG, tilt_rms(e.proof.after) / DEG, e.gravity
    return plain(
        {
            "schema": SCHEMA,
            "session": e.session.name,
            "verdict": e.verdict,
            "mismatch": {
                **p_entry("p_value", e.p_value),
                "closure_rms_deg": before_deg,
                "expected_rms_deg": e.problem.floor.tilt_rms / DEG,
                "unnamed_part": e.verdict in LEFT,
                "where": where(e),
            },
            "effects": [claim.to_json() for claim in e.claimed],
            "decision": None if e.decision is None else {name: e.decision.to_json()[name] for name in ("answer", "headline", "tests")},
            "findings": [claim.to_json() | {"share": claim.share} for claim in e.findings],
            "families": [family.to_json() for family in families_of(e)],
            "considered": [each.to_json() for each in e.considered],
            "lines_end_hz": lines_end_hz(e.twin),
            "fit": {
                "holdout_closure_rms_deg": {"before": before_deg, "after": after_deg, "floor": e.proof.floor_rms / DEG},
                "excess_removed": e.proof.removed,
                "segments_after": len(e.proof.after_numbers),
            },
            "channels": {
                name: p_entry("p_before", before)
                | p_entry("p_after", after)
                | {"rms_sigmas": dict(zip(("before", "after"), rms, strict=True))}
                for (name, (before, after)), rms in zip(e.own_p.items(), channel_rms(e).values(), strict=True)
            },
            "noise": e.problem.instability.to_json()
            | ({} if e.problem.at_rest is None else {"at_rest": table_of(e.problem.at_rest)})
            | {"components": e.noise.to_json()},
            "detection_limits": {
                name: {"size": size if np.isfinite(size) else None, "unit": catalogue()[name].parameter.unit}
                for name, size in e.detection_limits.items()
            },
            "warnings": plain(e.warnings),
            "next": what_next(e),
            "logs": {file_key(log.path): hash_of_log(log) for log in e.session.logs},
            "version": VERSION,
        }
        | (
            {"refused": [claim.to_json() for claim in e.naming.refused]}
            if gravity is None
            else {
                "turn_gravity": {
                    "lever_m": gravity.lever_m,
                    "offset_s": gravity.offset_s,
                    "offset_std_s": gravity.whole_sigma_s,
                    "rms_mg": {"before": 1e3 * gravity.before_mps2 / G, "after": 1e3 * gravity.after_mps2 / G},
                },
                "within_stills": {f"{name}_rms_sigmas": rms_of(sigmas) for name, sigmas in e.within.items()},
            }
        )
        | ({} if e.shown is None else e.shown.to_json())
    )
