"""What was said of one session, against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.challenge.reliability import Statement, statements

#: a moment, a row or a still counts as found within this of the true one
NEAR = {"at_s": 0.5, "at": 4, "stills": 0}
#: of the moments must be found, and as few may be invented
FOUND = 0.8
OUTSIDE = "outside."
#: what `explain` calls a finding
NAMELESS = "unknown."
KINDS = ("nothing", "one", "two", "three", "four", "outside", "beside")


@dataclass(frozen=True)
class Score:
    """truth, claimed: ids; verdict; and, of a session in which something is hidden: found, wrong, missed (ids).

    exact: named exactly; found: hidden ones that are named, or in the equivalents of one that is; wrong: named ones that are not hidden
    and have no hidden equivalent (for what is in no catalogue: no shape without a name); sigmas: errors of the parameters in their
    reported std; right: whether each is within 3 of them or 10 % of the truth; removed: share of the excess misfit that the refit took
    up, or None; statements: names with a stated probability.  strength: of the weakest that is hidden; odr_hz, instability_dph, told: the
    session's data rate, its gyro's bias instability and what session.toml told of it, None where the truth does not say.
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
    told: str | None = None

    @property
    def kind(self) -> str:
        """One of ``KINDS``: how many effects of the catalogue are hidden, ``outside`` for one of no catalogue, ``beside`` for both."""
        outside = sum(name.startswith(OUTSIDE) for name in self.truth)
        if outside:
            return "outside" if outside == len(self.truth) else "beside"
        return KINDS[len(self.truth)]

    @property
    def covered(self) -> bool:
        """All that is hidden is named or among the equivalents, and nothing else is."""
        return not self.missed and not self.wrong

    @property
    def alarmed(self) -> bool:
        """Whether ``explain`` said that something is wrong."""
        return self.verdict != "no_mismatch"


def score(name: str, truth: dict, said: dict) -> Score:
    """Compare ``truth`` (effects: id -> parameters, strength, what ``Score`` has of the session) with ``said`` (``tinygc-explain/1``)."""
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
        told=truth.get("told"),
    )


def _contains(ids: set[str], hidden: dict) -> bool:
    """Whether the truth is among ids: by its name, or, where it has none, as a shape without a name."""
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
