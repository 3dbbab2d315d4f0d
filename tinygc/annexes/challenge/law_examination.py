"""The examination of the search for laws: sessions that hide one, the scores, the tables."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.io.samples import Samples
from session.io.units import DEG
from tinygc.annexes.challenge.cases import INSTABILITY_SOURCES, LEAST_HZ, MAKERS, NEEDS, STRENGTHS, Case, case_of, drawn, taking_turns
from tinygc.annexes.challenge.examination import SESSIONS, Examination, as_table, asked_blind, explained, hide, new_folder, opened
from tinygc.annexes.challenge.laws import BY_HAND, LAWS
from tinygc.annexes.challenge.rate_effects import RATE_EFFECTS
from tinygc.effects import Conditions, Effect, EffectError, Movement, Parts, catalogue, movement_of, using
from tinygc.reporting.terminal import Group, Table, Text
from tinygc.simulation import simulator
from tinygc.simulation.options import GYRO_LPF2_HZ
from tinygc.simulation.simulator import fine_grid, true_signals, unit_of

# Draw sessions with a hidden law, and compute the added rates of the truth and of the answers.

# Draw the hidden effect of each session: a law, nothing, an effect of the catalogue, or one together with a law.

#: shares of sessions by hidden effects; ``drawn``: a law from the random grammar
SHARES = {"nothing": 0.25, "catalogue": 0.10, "beside": 0.10, "by hand": 0.37, "drawn": 0.18}
WARM = {"warm_up_c": 10.0}
NEEDED = {
    **NEEDS,
    "law.temperature_rate": WARM,
    "law.package_strain": WARM,
    "law.temperature_curve": WARM,
    "law.warm_gravity": WARM,
    "law.warm_square": WARM,
    "law.random": WARM,
}
#: Hz: tremor and a suspension must pass, and rates beyond 208 Hz only take more time
RATES = {104.0: 0.3, 208.0: 0.6, 416.0: 0.1}
LEAST = {**LEAST_HZ, "law.vibration_scale": 208.0, "law.resonance": 208.0}
SEGMENTS = (38, 49)
#: strengths of an effect hidden with a law: large enough to be named
BESIDE = (1.0, 0.5)
#: catalogue effects not hidden with these laws: they share a delay, a trend in time or a bend of the scale and cannot be distinguished
_DELAYS = {"gyro.angular_acceleration", "gyro.bandwidth", "timing.axis_skew", "timing.gyro_accel_offset"}
_COURSES = {"gyro.thermal_bias", "gyro.bias_drift", "gyro.bias_step"}
_GRAVITY = {"gyro.g_sensitivity"}
_BENDS = {"gyro.scale_nonlinearity", "gyro.scale_asymmetry"}
ALIKE = {
    "law.resonance": _DELAYS,
    "law.drive_recovery": _DELAYS | _BENDS,
    **dict.fromkeys(("law.magnetic_zero", "law.gravity_creep", "law.warm_gravity"), _GRAVITY),
    **dict.fromkeys(("law.sag_recovery", "law.temperature_rate", "law.package_strain", "law.temperature_curve", "law.telegraph"), _COURSES),
    **dict.fromkeys(("law.drive_droop", "law.dead_zone", "law.root_scale", "law.soft_limit", "law.warm_square"), _BENDS),
    "law.vibration_scale": {"gyro.vibration_rectification"},
    "law.anisoelastic": {"gyro.g2_sensitivity"},
}


def draw_discover_cases(count: int, seed: int, segments: int | None = None) -> list[Case]:
    """Draw ``count`` cases; laws and strengths alternate.  A law comes first, as it acts on the true rate.

    A case depends on its place and the seed alone: fewer cases are the first of more.
    """
    kinds = _kinds(count)
    number = {kind: kinds.count(kind) for kind in SHARES}
    # One stream for each list, so that the length of one does not affect the others.
    streams = [np.random.default_rng([seed, stream]) for stream in range(5)]
    turns = [STRENGTHS[i] for i in streams[0].permutation(len(STRENGTHS))]
    sources = taking_turns(list(INSTABILITY_SOURCES), count, streams[1])
    firsts = {
        "by hand": taking_turns(list(BY_HAND), number["by hand"], streams[2]),
        "beside": taking_turns(list(BY_HAND), number["beside"], streams[3]),
        "catalogue": taking_turns(list(RATE_EFFECTS), number["catalogue"], streams[4]),
        "drawn": ["law.random"] * number["drawn"],
    }
    given = dict.fromkeys(SHARES, 0)
    cases = []
    for place, kind in enumerate(kinds):
        rng, turn = np.random.default_rng([seed, len(streams), place]), given[kind]
        given[kind] += 1
        ids: tuple[str, ...] = (firsts[kind][turn],) if kind in firsts else ()
        strengths: tuple[float, ...] = (turns[turn % len(turns)],) if kind in firsts else ()
        if kind == "beside":
            other = str(rng.choice([name for name in RATE_EFFECTS if name not in ALIKE.get(ids[0], ())]))
            ids, strengths = (*ids, other), (*strengths, float(rng.choice(BESIDE)))
        length = int(rng.integers(*SEGMENTS)) if segments is None else segments
        cases.append(case_of(place, ids, strengths, sources[place], rng, length, NEEDED, RATES, LEAST))
    return cases


def _kinds(count: int) -> list[str]:
    """For each place, the kind that is furthest below its share, so that any count has the right proportions."""
    kinds: list[str] = []
    for place in range(count):
        kinds.append(max(SHARES, key=lambda kind: SHARES[kind] * (place + 1) - kinds.count(kind)))
    return kinds


# The rate added by a case's hidden effects, at the sensor's samples and without noise.

#: all effects that may be hidden
ALL = {**MAKERS, **LAWS}


@dataclass(frozen=True, eq=False)
class AddedRate:
    """Signals at the recorded samples, after the chip's low-pass.  movement: the true one, without noise and hidden rate effects;
    law (N, 3): rate added by the law, zero where none is hidden; catalogue: by id, rate added by catalogue effects after it; rad/s."""

    movement: Movement
    law: np.ndarray
    catalogue: dict[str, np.ndarray]


def added_rate(case: Case) -> AddedRate:
    """Compute the added rates, with the same draws as ``conceal``."""
    hidden, plan = drawn(case, ALL)
    options, unit = case.options, unit_of(case.options)
    t, factor, run_up = fine_grid(unit.odr_hz, int(np.ceil(plan.log_s * unit.odr_hz)))
    rate, force, temp = true_signals(options, unit, plan, t)

    def sampled(values: np.ndarray, hz: float = GYRO_LPF2_HZ[options.odr_hz]) -> np.ndarray:
        return simulator.low_pass(values, hz, 0.0, unit.odr_hz, factor, np.random.default_rng(0))[run_up:]

    felt = force
    for one in hidden:
        felt = felt if one.disturb is None else one.disturb(t, felt)
    law, catalogue, now = np.zeros((len(t) // factor - run_up, 3)), {}, rate
    for one in hidden:
        if one.distort is None:
            continue
        after = one.distort(t, now, force, temp)
        if one.id in LAWS:
            law = law + sampled(after - now)
        else:
            catalogue[one.id] = sampled(after - now)
        now = after
    samples = Samples(
        np.rint(1e9 * t[run_up * factor :: factor]).astype(np.int64),
        sampled(rate),
        sampled(felt, simulator.ACCEL_BANDWIDTH_ODR * unit.odr_hz),
        temp[run_up * factor :: factor],
    )
    known = Conditions(plan.log_s, options.gyro_fs_dps * DEG, options.temperature_start_c)
    return AddedRate(movement_of(samples, samples.gyro, known), law, catalogue)


# The answer for a session as a curve: the rate that its laws, or its catalogue effects, add to a movement.

#: name of an explain folder
EFFECTS = "effects"


def added_by_laws(laws: Sequence[dict], folder: Path, movement: Movement) -> list[np.ndarray]:
    """Rate added by each law of ``discovery.laws``, (N, 3) rad/s; folder: the explain folder with their files, which are run as Python.

    Raises EffectError for a file that is missing or broken, or whose id or parameters differ from the answer.
    """
    if not laws:
        return []
    places = {str((folder / law["file"]).parent) for law in laws}
    with using(sorted(places)):
        known = catalogue()
        missing = [law["id"] for law in laws if law["id"] not in known]
        if missing:
            raise EffectError(f"{folder}: no file defines {', '.join(missing)}")
        constants = [{name: each["value"] for name, each in law.get("constants", {}).items()} for law in laws]
        return [added(known[law["id"]], own | law["parameters"], movement) for law, own in zip(laws, constants, strict=True)]


def added_by_names(effects: Sequence[dict], movement: Movement) -> np.ndarray | None:
    """Rate added by all ``effects`` of ``tinygc-explain/2`` together, (N, 3) rad/s; None where none changes the rate."""
    known = catalogue()
    curves = [
        added(known[each["id"]], each["parameters"], movement)
        for each in effects
        if each["id"] in known and known[each["id"]].kind == "rate"
    ]
    return sum(curves[1:], curves[0]) if curves else None


def added(effect: Effect, told: dict, movement: Movement) -> np.ndarray:
    """Rate added by an effect with parameters by their JSON names, in their units, (N, 3) rad/s."""
    if effect.scan is not None and effect.scan.name in told:
        effect = effect.at(float(np.ravel(told[effect.scan.name])[0]) * effect.scan.si)
    for form in (effect, effect.wider, effect.of_readings):
        theta = None if form is None else _theta(form, told)
        if form is not None and theta is not None:
            return form.distort(movement, theta) - movement.rate
    raise EffectError(f"{effect.id}: its parameters are {', '.join(told)}, expected {effect.parameter.size} of {effect.parameter.name}")


def _theta(effect: Effect, told: dict) -> np.ndarray | None:
    """(P,) SI; None where the parameters have another form."""
    if isinstance(effect.derived, Parts):
        return effect.derived.theta(told) if all(name in told for name, _, _ in effect.derived.parts) else None
    value = told.get(effect.parameter.name)
    if value is None or np.size(value) != effect.parameter.size:
        return None
    return np.ravel(value).astype(float) * effect.parameter.si


# Blind test of the law search: inject, seal, search, open, score, tables.

# The score of one session: the answer's and the truth's added rates over the recording, compared beyond a linear calibration.
#
# Both are evaluated on the true movement at the recorded samples: on noisy readings the exact law of a dead zone at rest would differ
# from itself.

#: correlation above which two laws are the same over a recording: they differ by 14 % of their size
SAME = 0.99
#: correlation up to which the reported law is a different one, not a similar one
FAR = 0.9
#: outcomes of a session with a hidden law, and of one without
WITH_LAW = ("found", "catalogue_equal", "ambiguous", "wrong", "missed")
WITHOUT_LAW = ("silent", "ambiguous", "invented")


@dataclass(frozen=True)
class LawScore:
    """hidden: ids, law: that of the law or None; strength: the law's, or of what is hidden instead; expression: of a drawn law.

    outcome, with a law: ``found``, its curve is the truth's (correlation > SAME); ``catalogue_equal``: no law, and the catalogue's effects
    give the truth's curve; ``ambiguous``; ``wrong``: a law with another curve; ``missed``: none was reported.  Without a law: ``silent``,
    ``ambiguous`` or ``invented``.  correlation: of all reported laws together (of the catalogue's effects, where there is no law); listed:
    the best of the single ones; why: an error in the files, if any; misnamed: a law is hidden, none was reported, and catalogue effects
    that add another rate were; removed, p_value, chance_p: the answer's own evidence, the least of its laws.
    """

    name: str
    hidden: tuple[str, ...]
    law: str | None
    strength: float | None
    expression: str | None
    outcome: str
    equations: tuple[str, ...]
    named: tuple[str, ...]
    misnamed: bool
    correlation: float | None
    listed: float | None
    removed: float | None
    p_value: float | None
    chance_p: float | None
    seconds: float | None
    why: str | None

    @property
    def listed_same(self) -> bool:
        """Whether one of the listed laws is numerically the truth."""
        return self.listed is not None and self.listed > SAME

    @property
    def kind(self) -> str:
        """``law``, ``beside`` (a law with an effect of the catalogue), ``catalogue`` or ``nothing``."""
        if self.law is not None:
            return "law" if len(self.hidden) == 1 else "beside"
        return "catalogue" if self.hidden else "nothing"


def correlation(true: AddedRate, truth: dict, said: np.ndarray) -> float:
    """Correlation of the law's curve with another (N, 3), after regression of both on a bias, a 3x3 of the rate and the columns of the
    hidden catalogue effects (truth: id -> parameters); 0 where nothing is left of one."""
    left = [_beyond(true, truth, curve).ravel() for curve in (true.law, said)]
    sizes = [float(np.linalg.norm(each)) for each in left]
    whole = float(np.linalg.norm(said))
    return float(left[0] @ left[1] / (sizes[0] * sizes[1])) if sizes[0] > 0 and sizes[1] > 1e-9 * whole > 0 else 0.0


def _beyond(true: AddedRate, truth: dict, curve: np.ndarray) -> np.ndarray:
    """Residual (N, 3) of least squares over all axes, by the normal equations of unit columns."""
    known = np.column_stack([np.ones(len(curve)), true.movement.rate])
    blocks = [np.kron(np.eye(3), column[:, None]).reshape(3, -1, 3).transpose(1, 0, 2) for column in known.T]
    blocks += [one[:, :, None] for one in true.catalogue.values()]
    blocks += [columns for name in true.catalogue if (columns := _columns(name, truth[name], true.movement)) is not None]
    design = np.concatenate(blocks, axis=2).reshape(curve.size, -1)
    design = design / np.maximum(np.linalg.norm(design, axis=0), 1e-300)
    theta, *_ = np.linalg.lstsq(design.T @ design, design.T @ curve.ravel(), rcond=1e-10)
    return (curve.ravel() - design @ theta).reshape(curve.shape)


def _columns(name: str, parameters: dict, movement: Movement) -> np.ndarray | None:
    """Columns (N, 3, P) of an effect of the catalogue, at its true moment."""
    effect = catalogue()[name]
    if effect.kind != "rate":
        return None
    if effect.scan is not None and effect.scan.name in parameters:
        effect = effect.at(float(parameters[effect.scan.name]) * effect.scan.si)
    return effect.columns(effect.shown(movement))


def score_law(name: str, truth: dict, said: dict, true: AddedRate, folder: Path) -> LawScore:
    """truth: as it was sealed; said: ``tinygc-explain/2`` with ``discovery``; folder: the explain folder with the laws' files."""
    law = next((each for each in truth["effects"] if each in LAWS), None)
    discovery = said.get("discovery") or {"verdict": "none", "laws": []}
    laws, verdict, why = discovery["laws"], discovery["verdict"], None
    named = tuple(each["id"] for each in said["effects"])
    together = listed = None
    if law is not None:
        try:
            curves = added_by_laws(laws, folder, true.movement)
            alone = [correlation(true, truth["effects"], curve) for curve in curves]
            listed = max(alone, default=None)
            names = added_by_names(discovery.get("catalogue_effects", []), true.movement) if curves else None
            whole = curves if names is None else [*curves, names]
            together = correlation(true, truth["effects"], sum(whole[1:], whole[0])) if curves else None
        except EffectError as error:
            why = str(error)
        if not laws and (by_names := added_by_names(said["effects"], true.movement)) is not None:
            together = correlation(true, truth["effects"], by_names)
    outcome = _outcome(law, verdict, bool(laws), together)
    proofs = [proof for each in laws for proof in each["held_out"]]
    strengths = truth.get("strengths", {})
    return LawScore(
        name=name,
        hidden=tuple(truth["effects"]),
        law=law,
        strength=truth["strength"] if law is None else strengths.get(law, truth["strength"]),
        expression=None if law is None else truth["effects"][law].get("expression"),
        outcome=outcome,
        equations=tuple(each["equation"] for each in laws),
        named=named,
        misnamed=law is not None and outcome == "missed" and bool(set(named) - set(truth["effects"])),
        correlation=together,
        listed=listed,
        removed=min((each["removed"] for each in proofs if each["removed"] is not None), default=None),
        p_value=max((each["p_value"] for each in proofs), default=None),
        chance_p=max((each["chance_p"] for each in laws), default=None),
        seconds=said.get("seconds"),
        why=why or said.get("why"),
    )


def _outcome(law: str | None, verdict: str, has_laws: bool, together: float | None) -> str:
    if verdict == "ambiguous":
        return "ambiguous"
    same = together is not None and together > SAME
    if verdict == "found" and has_laws:
        return "invented" if law is None else "found" if same else "wrong"
    if law is None:
        return "silent"
    return "catalogue_equal" if same else "missed"


# The tables of the law search's blind test: by strength, by law, and the answers where no law is hidden.

OTHERS = {"nothing": "nothing hidden", "catalogue": "an effect of the catalogue alone"}


def law_tables(result: Examination[LawScore]) -> Group:
    """The printed output of ``calibrate.py challenge --discover``."""
    tables = [_by_strength(result.scores), _by_law(result.scores), _without(result.scores)]
    return Group(*[part for table in tables for part in (table, Text(""))], Text("\n".join(sentences(result.scores))))


def _by_strength(scores: list[LawScore]) -> Table:
    heads = (outcome.replace("_", " ") for outcome in WITH_LAW)
    table = Table("strength", "sessions", *heads, "correlation", "excess gone", "s", title="laws that stand in no catalogue, by strength")
    hidden = [each for each in scores if each.law is not None]
    for strength in (*STRENGTHS, None):
        group = hidden if strength is None else [each for each in hidden if each.strength == strength]
        if group:
            counts = (str(_count(group, outcome)) for outcome in WITH_LAW)
            table.add_row("all" if strength is None else f"× {strength:g}", str(len(group)), *counts, *_proofs(group))
    return table


def _by_law(scores: list[LawScore]) -> Table:
    heads = [f"× {strength:g}" for strength in STRENGTHS]
    table = Table("law", *heads, "correlation", "excess gone", "s", title="f found, = catalogue equal, a ambiguous, w wrong, m missed")
    laws = sorted({each.law for each in scores if each.law is not None})
    for law in laws:
        group = [each for each in scores if each.law == law]
        cells = [" ".join(_letter(each) for each in group if each.strength == strength) for strength in STRENGTHS]
        table.add_row(law.removeprefix("law."), *cells, *_proofs(group))
    return table


def _letter(score: LawScore) -> str:
    letter = "=" if score.outcome == "catalogue_equal" else score.outcome[0]
    return f"{letter}+" if score.kind == "beside" else letter


def _without(scores: list[LawScore]) -> Table:
    table = Table("hidden", "sessions", *WITHOUT_LAW, "s", title="where there is no law")
    for kind, title in OTHERS.items():
        group = [each for each in scores if each.kind == kind]
        if group:
            table.add_row(title, str(len(group)), *(str(_count(group, outcome)) for outcome in WITHOUT_LAW), _seconds(group))
    return table


def _count(group: list[LawScore], outcome: str) -> int:
    return sum(each.outcome == outcome for each in group)


def _proofs(group: list[LawScore]) -> tuple[str, str, str]:
    """Correlation, least and median, and removed share of the held-out excess, of found laws; median seconds."""
    found = [each for each in group if each.outcome == "found"]
    alike = [each.correlation for each in found if each.correlation is not None]
    gone = [100 * each.removed for each in found if each.removed is not None]
    return (
        f"{np.median(alike):.4f} (least {min(alike):.4f})" if alike else "–",
        f"{np.median(gone):.1f} % (least {min(gone):.1f})" if gone else "–",
        _seconds(group),
    )


def _seconds(group: list[LawScore]) -> str:
    seconds = [each.seconds for each in group if each.seconds is not None]
    return f"{np.median(seconds):.0f}" if seconds else "–"


def totals(scores: list[LawScore]) -> dict:
    """Counts and medians over all sessions, JSON-ready."""
    hidden = [each for each in scores if each.law is not None]
    found = [each for each in hidden if each.outcome == "found"]
    wrong = [each for each in hidden if each.outcome == "wrong"]
    gone = [each.removed for each in found if each.removed is not None]
    seconds = [each.seconds for each in scores if each.seconds is not None]
    return {
        "sessions": len(scores),
        "with_law": {outcome: _count(hidden, outcome) for outcome in WITH_LAW} | {"sessions": len(hidden)},
        "far": sum(each.correlation is None or each.correlation <= FAR for each in wrong),
        "misnamed": sum(each.misnamed for each in hidden),
        "ambiguous_with_equal": sum(each.outcome == "ambiguous" and each.listed_same for each in hidden),
        "strengths": [
            {"strength": strength, "sessions": len(group)} | {outcome: _count(group, outcome) for outcome in WITH_LAW}
            for strength in STRENGTHS
            if (group := [each for each in hidden if each.strength == strength])
        ],
        **{
            kind: {outcome: _count(group, outcome) for outcome in WITHOUT_LAW} | {"sessions": len(group)}
            for kind in OTHERS
            for group in [[each for each in scores if each.kind == kind]]
        },
        "removed_median": float(np.median(gone)) if gone else None,
        "removed_least": min(gone, default=None),
        "seconds_median": float(np.median(seconds)) if seconds else None,
        "seconds_most": max(seconds, default=None),
    }


def sentences(scores: list[LawScore]) -> list[str]:
    """The totals as sentences."""
    t = totals(scores)
    w = t["with_law"]
    lines = [
        f"{w['sessions']} sessions hide a law: {w['found']} found, {w['catalogue_equal']} given names of the catalogue that are "
        f"numerically equal, {w['ambiguous']} ambiguous ({t['ambiguous_with_equal']} with a law on the list that is numerically equal), "
        f"{w['wrong']} wrong ({t['far']} of them far: correlation at most {FAR:g}), {w['missed']} missed ({t['misnamed']} of them under "
        "other names)",
        *(
            f"{t[kind]['sessions']} hide {'nothing' if kind == 'nothing' else title}: {t[kind]['invented']} with an invented law, "
            f"{t[kind]['ambiguous']} ambiguous"
            for kind, title in OTHERS.items()
        ),
    ]
    if t["removed_median"] is not None:
        least, middle = 100 * t["removed_least"], 100 * t["removed_median"]
        lines.append(f"share of the held-out excess that a found law takes away: median {middle:.1f} %, least {least:.1f} %")
    if t["seconds_median"] is not None:
        lines.append(f"seconds for a session: median {t['seconds_median']:.0f}, most {t['seconds_most']:.0f}")
    return lines


# The blind test of the law search from end to end: inject, seal, search in copies of the sessions, open, score.

#: folder of the copies in which the workers search and write, below the sessions; folder of their laws
COPIES, EXAMINED_LAWS = "searched", "laws"
EXPLAIN = "explain"
Answer = Callable[[Path], dict]


def answered(folder: Path) -> dict:
    """The answer of a separate process for a copy of a session folder, where it may write."""
    return explained(folder, discover=True)


def examine_laws(
    folder: Path,
    count: int,
    seed: int,
    *,
    segments: int | None = None,
    answer: Answer = answered,
    announce: Callable[[str], None] = lambda text: None,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Examination[LawScore]:
    """Test the law search on ``count`` sessions in ``folder``, which must be empty or new.

    segments: of every session, instead of drawn; answer: evaluates each copy; announce: called with the SHA-256 before the first.
    """
    new_folder(folder)
    cases = draw_discover_cases(count, seed, segments)
    closed = hide(folder, cases, progress, ALL)
    announce(f"truth sealed, SHA-256 {closed.sha256}")
    # The workers write into copies, so the hidden session stays unchanged.
    copies = [Path(shutil.copytree(folder / SESSIONS / case.name, folder / SESSIONS / COPIES / case.name)) for case in cases]
    said = asked_blind(copies, answer, "searching blind", progress)
    truth = opened(folder, closed, said)
    scores: list[LawScore] = []
    for case, copy in zip(cases, copies, strict=True):
        progress("scoring", len(scores), count)
        scores.append(score_law(case.name, truth[case.name], said[case.name], added_rate(case), copy / EXPLAIN))
        if (copy / EXPLAIN / "effects").is_dir():
            shutil.copytree(copy / EXPLAIN / "effects", folder / EXAMINED_LAWS / case.name, ignore=shutil.ignore_patterns("__pycache__"))
    return Examination(seed, closed.sha256, scores, truth, said)


def to_json(result: Examination[LawScore]) -> dict:
    """``tinygc-discover-challenge/2``: every session with its truth, its answer and its score, and the totals."""
    return as_table("tinygc-discover-challenge/2", result, totals(result.scores))
