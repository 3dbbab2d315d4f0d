"""Impacts in turns: how many, the hardest, and how near to the turn's end."""

from __future__ import annotations

from itertools import pairwise

from session.checks.findings import Finding
from session.detect.impacts import JUMP_G, find_impacts
from session.detect.segments import why_broken
from session.detect.stills import Still
from session.log.config import Sensor
from session.log.samples import Samples

WHAT = "impacts"


def check_impacts(where: str, samples: Samples, stills: list[Still], sensor: Sensor) -> list[Finding]:
    """Of the turns between neighbouring stills, but for those that are broken besides; nothing where there is none."""
    found = find_impacts(samples)
    turns = [(first.stop, last.start) for first, last in pairwise(stills)] if found else []
    turns = [(start, stop) for start, stop in turns if why_broken(samples, slice(start, stop + 1), sensor) is None]
    hit = {number: [each for each in found if start <= each.row < stop] for number, (start, stop) in enumerate(turns)}
    hit = {number: impacts for number, impacts in hit.items() if impacts}
    if not hit:
        return []
    number, worst = max(((n, each) for n, impacts in hit.items() for each in impacts), key=lambda pair: pair[1].jump_g)
    before_s = float(samples.t_s[turns[number][1]]) - worst.at_s
    says = (
        f"{len(hit)} of {len(turns)} turns hold one: specific force jumps by {JUMP_G:g} g or more from one reading to the next, "
        f"most by {worst.jump_g:.1f} g at {worst.at_s:.1f} s, {before_s:.1f} s before the next rest"
    )
    do = "a softer stop or a slower hand; a fit weighs such turns by how they close"
    return [Finding("note", where, WHAT, says, do)]
