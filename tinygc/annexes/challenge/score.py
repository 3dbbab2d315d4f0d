"""Score one session's answer against the truth, and test whether stated probabilities are calibrated."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tinygc.annexes.challenge.cases import MOST_INSTABILITY_DPH

# Calibration of stated probabilities: statements by bins, and the expected calibration error.

#: edges of the bins: fine where names are claimed, coarse where a name was only considered
EDGES = (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 1.0)
#: first bin of the text table
CLAIMS_FROM = 0.5


@dataclass(frozen=True)
class Statement:
    """``id`` is in the recording, with a probability; claimed: reported, not only considered; right: whether it is hidden there."""

    id: str
    probability: float
    claimed: bool
    right: bool


@dataclass(frozen=True)
class Bin:
    """Statements with a probability from ``low`` to ``high``: how many, the share that are right, the mean stated probability."""

    low: float
    high: float
    number: int
    share_right: float | None
    mean_stated: float | None


def statements(said: dict, hidden: Iterable[str]) -> tuple[Statement, ...]:
    """Names with a probability in ``said`` (``tinygc-explain/2``), each id once; an unnamed shape has none."""
    known, stated = set(hidden), {}
    for claimed, group in ((False, said.get("considered") or ()), (True, said["effects"])):
        for each in group:
            if each.get("probability") is not None and not each["id"].startswith("unknown."):
                stated[each["id"]] = Statement(each["id"], float(each["probability"]), claimed, each["id"] in known)
    return tuple(stated.values())


def reliability(stated: Iterable[Statement]) -> list[Bin]:
    """The statements by bins of their probability, all bins of ``EDGES``."""
    everything = list(stated)
    p = np.array([each.probability for each in everything])
    right = np.array([each.right for each in everything], dtype=bool)
    place = np.clip(np.searchsorted(EDGES, p, side="right") - 1, 0, len(EDGES) - 2)
    bins = []
    for number, (low, high) in enumerate(pairwise(EDGES)):
        here = place == number
        count = int(here.sum())
        bins.append(Bin(low, high, count, float(right[here].mean()) if count else None, float(p[here].mean()) if count else None))
    return bins


def calibration_error(stated: Iterable[Statement]) -> float | None:
    """Expected calibration error: mean over the statements of each bin's distance between stated mean and share right; None without any."""
    bins = [each for each in reliability(stated) if each.share_right is not None and each.mean_stated is not None]
    total = sum(each.number for each in bins)
    return sum(each.number * abs((each.share_right or 0.0) - (each.mean_stated or 0.0)) for each in bins) / total if total else None


# The answer for one session, against the truth.

#: a moment, a row or a still counts as found within this distance of the true one
NEAR = {"at_s": 0.5, "at": 4, "stills": 0}
#: least share of the moments found, and of those reported that are true
FOUND = 0.8
OUTSIDE = "outside."
#: prefix of unnamed shapes in ``explain``
NAMELESS = "unknown."
KINDS = ("nothing", "one", "two", "three", "four", "outside", "beside")


@dataclass(frozen=True)
class Score:
    """truth, claimed: ids; verdict; and, of a session in which something is hidden: found, wrong, missed (ids).

    exact: named exactly; found: hidden ones that are named, or in the equivalents of one that is; wrong: named ones that are not hidden
    and have no hidden equivalent (for effects outside the catalogue: no unnamed shape); sigmas: errors of the parameters in their
    reported std; right: whether each is within 3 of them or 10 % of the truth; removed: share of the excess misfit that the refit removes,
    or None; statements: names with a stated probability.  strength: of the weakest that is hidden; odr_hz, instability_dph,
    instability_source: the session's data rate, its gyro's bias instability and its entry in session.toml, None where the truth lacks them.
    """

    name: str
    truth: tuple[str, ...]
    strength: float | None
    verdict: str
    claimed: tuple[str, ...]
    exact: bool
    found: tuple[str, ...]
    wrong: tuple[str, ...]
    missed: tuple[str, ...]
    sigmas: tuple[float, ...]
    right: tuple[bool, ...]
    removed: float | None
    statements: tuple[Statement, ...] = ()
    odr_hz: float | None = None
    instability_dph: float | None = None
    instability_source: str | None = None

    @property
    def kind(self) -> str:
        """One of ``KINDS``: number of hidden catalogue effects, ``outside`` for one outside the catalogue, ``beside`` for both."""
        outside = sum(name.startswith(OUTSIDE) for name in self.truth)
        if outside:
            return "outside" if outside == len(self.truth) else "beside"
        return KINDS[len(self.truth)]

    @property
    def covered(self) -> bool:
        """Whether every hidden effect is named or among the equivalents, and nothing else is."""
        return not self.missed and not self.wrong

    @property
    def alarmed(self) -> bool:
        """Whether ``explain`` reported an error."""
        return self.verdict != "no_mismatch"


def score(name: str, truth: dict, said: dict) -> Score:
    """Compare ``truth`` (effects: id -> parameters, strength, session data as in ``Score``) with ``said`` (``tinygc-explain/2``)."""
    hidden, claims = truth["effects"], {effect["id"]: effect for effect in said["effects"]}
    stands_for = {claim: {claim, *effect["equivalent"]} for claim, effect in claims.items()}
    named = {each for each in hidden if not each.startswith(OUTSIDE)}
    found = tuple(each for each in hidden if any(each in ids for ids in stands_for.values()))
    sigmas, right = [], []
    for each in hidden.keys() & claims.keys():
        now = parameter_errors(claims[each], hidden[each])
        sigmas += now[0]
        right += now[1]
    return Score(
        name=name,
        truth=tuple(hidden),
        strength=truth["strength"],
        verdict=said["verdict"],
        claimed=tuple(claims),
        exact=set(hidden) == set(claims) or (0 < len(named) < len(hidden) and named == {c for c in claims if not c.startswith(NAMELESS)}),
        found=found,
        wrong=tuple(claim for claim, ids in stands_for.items() if not _contains(ids, hidden)),
        missed=tuple(each for each in hidden if each not in found and not each.startswith(OUTSIDE)),
        sigmas=tuple(sigmas),
        right=tuple(right),
        removed=said["fit"]["excess_removed"] if claims and "fit" in said else None,
        statements=statements(said, hidden),
        odr_hz=truth.get("odr_hz"),
        instability_dph=truth.get("bias_instability_dph"),
        instability_source=truth.get("instability_source"),
    )


def _contains(ids: set[str], hidden: dict) -> bool:
    """Whether the truth is among ids: by its name, or as an unnamed shape where it has none."""
    nameless = any(each.startswith(OUTSIDE) for each in hidden) and any(each.startswith(NAMELESS) for each in ids)
    return nameless or bool(ids & hidden.keys())


def parameter_errors(effect: dict, truth: dict) -> tuple[list[float], list[bool]]:
    """Errors of an effect's parameter values in reported sigmas, and whether each is within 3 sigmas or 10 % of the largest.

    Lists of moments have no sigma: whether they were found is one entry of the second.
    """
    sigmas, right = [], []
    for name, true in truth.items():
        value = effect["parameters"].get(name)
        if value is None:
            continue
        if isinstance(true, list) and name in NEAR:
            near = [min((abs(v - t) for v in value), default=np.inf) <= NEAR[name] for t in true]
            right.append(bool(np.mean(near) >= FOUND and len(value) <= len(true) / FOUND))
            continue
        error = np.abs(np.ravel(value) - np.ravel(true))
        std = np.broadcast_to(np.ravel(effect["std"].get(name, 0.0)), error.shape)
        sigmas += [float(e / s) for e, s in zip(error, std, strict=True) if s > 0]
        right += [bool(x) for x in error <= np.maximum(3 * std, 0.1 * np.abs(true).max())]
    return sigmas, right


# Sources of false alarms and wrong names: by data rate, by the gyro's bias instability, and by its entry in session.toml.

#: deg/h: below a typical gyro's, about it, beyond
INSTABILITIES = (0.0, 2.0, 5.0, MOST_INSTABILITY_DPH)


def groups(scores: list[Score]) -> list[dict]:
    """For each group that has sessions: ``by``, ``group``, and counts of sessions, wrongly named ones, nulls and their false alarms."""
    groups: dict[tuple[str, float | str, str], list[Score]] = {}
    for each in scores:
        for key in _groups_of(each):
            groups.setdefault(key, []).append(each)
    ordered = sorted(groups, key=lambda key: (key[0], str(type(key[1])), key[1]))
    return [{"by": by, "group": name, **_counts(groups[by, place, name])} for by, place, name in ordered]


def _groups_of(each: Score) -> list[tuple[str, float | str, str]]:
    """Criterion, place in order, and name of each group that a session belongs to."""
    found: list[tuple[str, float | str, str]] = []
    if each.odr_hz is not None:
        found.append(("data rate", each.odr_hz, f"{each.odr_hz:g} Hz"))
    if each.instability_dph is not None:
        for low, high in pairwise(INSTABILITIES):
            if low <= each.instability_dph < high or each.instability_dph == high == MOST_INSTABILITY_DPH:
                found.append(("bias instability", low, f"{low:g} to {high:g} deg/h"))
    if each.instability_source is not None:
        found.append(("source of the bias instability", each.instability_source, each.instability_source))
    return found


def _counts(here: list[Score]) -> dict[str, int]:
    nulls = [each for each in here if each.kind == "nothing"]
    return {
        "sessions": len(here),
        "wrongly_named": sum(bool(each.wrong) for each in here),
        "nulls": len(nulls),
        "false_alarms": sum(each.alarmed for each in nulls),
    }
