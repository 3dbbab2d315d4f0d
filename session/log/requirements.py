"""Requirements: limits of quantities, and the rule by which a measured value meets them or not (docs/requirements.md).

They stand in ``[requirements]`` of session.toml.  The rules are applied in ``tinygc/verdict/requirements.py``.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from session.base.records import Key, record_of, stated
from session.base.results import Keys, MapOf, Mismatch, Number, Text, shown

SIMPLE, GUARDED = "simple acceptance", "guard band"
RULES = (SIMPLE, GUARDED)
SIDES = ("lower", "upper")
#: held-out closure of the segments, RMSE of each closure run, attitude after a minute at rest (expanded uncertainty)
CLOSURE, CLOSURE_RUN, ATTITUDE = "closure_deg", "closure_run_deg", "attitude_60s_deg"
#: never negative
SIZES = (CLOSURE, CLOSURE_RUN, ATTITUDE)
_LEANS = tuple(f"{a}_to_{b}" for a in "xyz" for b in "xyz" if a != b)
#: a kind of number, which stands for all of its components -> the components, and the unit behind both
KINDS = {
    "gyro_scale_factor_error": (tuple("xyz"), "ppm"),
    "gyro_misalignment": (_LEANS, "mrad"),
    "gyro_nonorthogonality": (("xy", "yz", "zx"), "mrad"),
    "gyro_triad_rotation": (tuple("xyz"), "mrad"),
    "gyro_bias": (tuple("xyz"), "mdps"),
    "accel_scale_factor_error": (tuple("xyz"), "ppm"),
    "accel_nonorthogonality": (("xy", "xz", "yz"), "mrad"),
    "accel_bias": (tuple("xyz"), "mg"),
}
#: key of a kind -> keys of its components
GROUPS = {f"{kind}_{unit}": tuple(f"{kind}_{part}_{unit}" for part in parts) for kind, (parts, unit) in KINDS.items()}
QUANTITIES = (CLOSURE, CLOSURE_RUN, ATTITUDE, *(key for keys in GROUPS.values() for key in keys))


@dataclass(frozen=True)
class Rule:
    """A decision rule.

    kind: one of ``RULES``; guard: r of the guard band w = r U; risk: in place of it, the largest probability of a wrong PASS and of a wrong
    FAIL; least_ratio: smallest test uncertainty ratio (upper - lower) / 2 U with which simple acceptance decides, None for any.
    """

    #: how a value with its uncertainty is decided
    kind: Annotated[str, Key("rule"), Text(RULES)] = SIMPLE
    #: r of the guard band w = r U; with `"guard band"`
    guard: Annotated[float, Number(0, 100)] = 1.0
    #: instead: largest probability that an answer is wrong
    risk: Annotated[float | None, Number(1e-9, 0.5, above=True)] = None
    #: with `"simple acceptance"`: not decided where (upper − lower) / 2 U is smaller; needs both limits
    least_ratio: Annotated[float | None, Number(0, 1e6, above=True)] = None


@dataclass(frozen=True)
class Requirements:
    """Limits (lower, upper) by quantity, infinite where one side is open; the rule; reference: where the limits are from, in the user's
    words; source: the file."""

    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    rule: Rule = field(default_factory=Rule)
    reference: str = ""
    source: str = ""

    @property
    def table(self) -> dict[str, Any]:
        """The section, or the file without its schema."""
        limits = {
            key: {side: value for side, value in zip(SIDES, both, strict=True) if math.isfinite(value)} for key, both in self.limits.items()
        }
        return stated(self.rule) | ({"reference": self.reference} if self.reference else {}) | limits


# Limits of quantities, as TOML sections with lower, upper or both.


def _bounds_of(sections: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """(lower, upper) by key, infinite where one side is open; a group's name stands for all of its keys, a key of its own wins.

    Raises Mismatch for an unknown name, a limit that is no number, and a lower one that is not below the upper.
    """
    found = dict[str, tuple[float, float]]()
    for name in sorted(sections, key=lambda each: each in QUANTITIES):
        if name not in QUANTITIES and name not in GROUPS:
            near = difflib.get_close_matches(name, [*GROUPS, *QUANTITIES], 1)
            hint = f"did you mean {near[0]}?" if near else "the names are in docs/requirements.md"
            raise Mismatch(f"{name:.60} is no quantity that has limits; {hint}")
        found |= dict.fromkeys(GROUPS.get(name, (name,)), _limits(sections[name], name))
    return found


def _limits(section: Any, name: str) -> tuple[float, float]:
    if not isinstance(section, dict):
        raise Mismatch(f"{name} is {shown(section)}, expected a section with lower, upper or both")
    if strange := sorted(set(section) - set(SIDES)):
        raise Mismatch(f"{name}.{strange[0]:.40} is no key of limits, expected lower, upper or both")
    if not section:
        raise Mismatch(f"{name} has no limit, expected lower, upper or both")
    for side, value in section.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 1e12:
            raise Mismatch(f"{name}.{side} is {value!s:.40}, expected a number")
    lower, upper = float(section.get("lower", -math.inf)), float(section.get("upper", math.inf))
    if not lower < upper:
        raise Mismatch(f"{name}.lower is {lower:g}, expected less than upper, {upper:g}")
    return lower, upper


# The section, and the file.

_RULE = record_of(Rule, null=False)
_KNOWN = Keys(may={**_RULE.may, "reference": Text()})


class RequirementsShape(MapOf):
    """``[requirements]``: the keys of the rule, and limits by quantity; unlike elsewhere, a key that is not known is refused, since a limit
    would silently not count."""

    def __init__(self) -> None:
        super().__init__(Text())

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, dict):
            self.refuse(value, where)
        _KNOWN.check(value, where)
        try:
            limits = _bounds_of({k: v for k, v in value.items() if k not in _KNOWN.may})
        except Mismatch as mismatch:
            raise Mismatch(f"{where}.{mismatch}" if where else str(mismatch)) from None
        for key, (lower, upper) in limits.items():
            at = f"{where}.{key}" if where else key
            if key in SIZES and upper <= 0:
                raise Mismatch(f"{at}.upper is {upper:g}, and it is a size; expected above 0")
            if key in SIZES and -math.inf < lower < 0:
                raise Mismatch(f"{at}.lower is {lower:g}, and it is a size; expected 0 or more")
        if not limits:
            raise Mismatch(f"{where or 'it'} has no limits, expected a section such as [requirements.closure_deg] with lower or upper")
        kind = value.get("rule", SIMPLE)
        if kind == SIMPLE and (odd := {"guard", "risk"} & set(value)):
            raise Mismatch(f'{where}.{min(odd)} goes with rule = "{GUARDED}", and the rule is {kind}')
        if kind == GUARDED and "least_ratio" in value:
            raise Mismatch(f'{where}.least_ratio goes with rule = "{SIMPLE}", and the rule is {kind}')
        if {"guard", "risk"} <= set(value):
            raise Mismatch(f"{where}.guard and risk are both given, expected one of them")
        if "least_ratio" in value and (one := next((key for key, sides in limits.items() if math.inf in map(abs, sides)), None)):
            raise Mismatch(f"{where}.least_ratio needs a lower and an upper limit, and {one} has one alone")

    def made(self, value: Any) -> Requirements:
        """Of no source."""
        limits = _bounds_of({key: sides for key, sides in value.items() if key not in _KNOWN.may})
        return Requirements(limits, _RULE.made(value), value.get("reference", ""))
