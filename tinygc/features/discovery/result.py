"""A discovery as JSON, and as facts for terminal and page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath

from session.base.numeric import sigmas_in
from session.base.records import table_of
from session.base.texts import measured, probability, significant
from session.base.units import DEG
from tinygc.explanation.claims import p_entry
from tinygc.features.discovery.enumeration import bits
from tinygc.features.discovery.quantities import QUANTITIES
from tinygc.features.discovery.search_state import NOISE_P, Discovery, Law
from tinygc.features.discovery.words import (
    ABBREVIATIONS,
    ARROW,
    NEIGHBOURS,
    SYMBOLS,
    UNITS,
    abbreviations,
    coefficient_unit,
    combination,
    constants_of,
    equation,
    in_words,
    terms_of,
)
from tinygc.reporting.explanation_text import parameter_lines
from tinygc.reporting.facts import Part
from tinygc.reporting.terminal import Text

# A discovery as the key ``discovery`` of ``tinygc-explain/2`` (docs/formats.md); the facts are made from the same table.


def to_json(discovery: Discovery, files: Sequence[str | None]) -> dict:
    """JSON-ready; files: of each law, relative to the folder of the explanation, None where none is written."""
    return {
        "verdict": discovery.verdict,
        "why": discovery.why,
        "laws": [law_table(law, file) for law, file in zip(discovery.laws, files, strict=True)],
        "catalogue_effects": list(discovery.accompanying),
        "forms": discovery.forms,
        "distinct": discovery.distinct,
        "chance": discovery.chance_promise,
        "best": discovery.best_promise,
        "learnable": {name: {"size_dps": None if size is None else size / DEG} for name, size in discovery.learnable.items()},
    }


def law_table(law: Law, file: str | None) -> dict:
    """One of ``laws``."""
    unit, name = coefficient_unit(law.form)
    shape = law.form.parameter_shape
    parameters, std = ((x / DEG).reshape(shape).tolist() for x in (law.theta, sigmas_in(law.covariance)))
    return {
        "id": law.effect.id if file is None else PurePosixPath(file).stem.replace("_", ".", 1),  # discovered_rate.py: discovered.rate
        "equation": equation(law.form),
        "in_words": in_words(law.form),
        "parameters": {name: parameters},
        "std": {name: std},
        "unit": unit,
        "terms": terms_of(law.form),
        "constants": {
            each.json: {"value": each.number, "sigma": each.sigma, "unit": each.unit or "fraction"}
            for each in constants_of(law.form, law.constants_sigma)
        },
        "bits": bits(law.form),
        "chi_square": law.gain,
        "better_by": law.better,
        "chance_p": law.chance_p,
        "held_out": [table_of(each) | p_entry("p_value", each.p_value) | p_entry("noise_p", each.noise_p) for each in law.held_out],
        "file": file,
        "same_here": [equation(form) for form in law.same],
        "runners_up": [
            {
                "id": each.effect.id if each.form is None else None,
                "equation": each.effect.equation,
                "worse_by": each.nearest,
                "correlation": each.correlation,
                "discriminating_motion": each.effect.discriminating_motion,
            }
            for each in law.runners_up
        ],
        "learnable_from": law.learnable_from,
        "not_observed": [{"in_words": combination(law.form, each), "direction": each.reshape(shape).tolist()} for each in law.unobserved],
    }


def briefly(text: str) -> str:
    """An equation without the definitions of its symbols."""
    for note in (*SYMBOLS.values(), NEIGHBOURS, *ABBREVIATIONS.values()):
        text = text.split(f", {note}")[0]
    return text


# A discovery as facts: equation, evidence, alternatives, and use.

HEADLINES = {
    "found": ("an equation was found", "green"),
    "ambiguous": ("equations were found, and this recording cannot decide between them", "yellow"),
    "none": ("no equation of this grammar", "yellow"),
}
MOST_RUNNERS_UP = 3
MOST_SAME = 3
#: quantities whose detection limits are on the page
MOST_LEARNABLE = 6


def headline(verdict: str, has_rivals: bool) -> tuple[str, str]:
    """The verdict in words, and its colour."""
    if verdict == "ambiguous" and not has_rivals:
        return "an equation stands out, and this recording cannot decide whether it is the one", "yellow"
    return HEADLINES[verdict]


def discovery_facts(table: dict, following: str | None = None, brief: bool = False) -> list[Part]:
    """Facts of a discovery, from its table: the answer, then each law with its numbers, evidence and rivals; brief: for the first screen;
    following: what to do next."""
    laws, words_style = table["laws"], headline(table["verdict"], any(law["runners_up"] for law in table["laws"]))
    facts: list[Part] = [Text(f"{'FOUND' if laws else 'NOTHING FOUND'}: {words_style[0]}.", words_style[1])]
    for law in laws:
        equation = briefly(law["equation"]) if brief else law["equation"]
        facts += ["", Text.assemble((f"{law['id']}  ", "bold cyan"), equation), f"  {law['in_words']}"]
        evidence = [held_out_words(each) for each in law["held_out"][:1]] if brief else evidence_words(law)
        facts += [f"  {line}" for line in (*number_lines(law), *evidence)]
        facts += [Text(f"  {line}", "yellow") for line in open_words(law)[: 1 if brief else None]]
        facts += [f"  written as {law['file']}"] if law["file"] else []
    if not brief:
        facts += [""] if laws else []
        facts += [f"{table['forms']} forms tried, {table['distinct']} of them distinct here"] if table["forms"] else []
        facts += [f"in these equations: {short}"] if (short := abbreviated(table)) else []
        named = [(each["id"], *parameter_lines(each["parameters"], each["std"])) for each in table["catalogue_effects"] if laws]
        facts += [f"together with: {'  '.join(each)}" for each in named]
    if not brief and not laws and table["forms"]:
        # Effects of an answer without a law come from part of the recording, untested: the explanation above lists its own.
        facts.append(
            f"the best form promises {significant(table['best'])} in −2 log evidence by its linear columns, its description paid; "
            f"in noise alone the best of so many promises more than {significant(table['chance'])} in 1 of 20 searches"
        )
    facts += [line for line in (table["why"], "" if brief else _learnable(table["learnable"])) if line]
    return [*facts, *([Text.assemble(("next: ", "bold"), following)] if following else [])]


def evidence_words(law: dict) -> list[str]:
    """Evidence for a law: chi-square, chance, held-out segments, and its detection limit."""
    chance = probability(law["chance_p"])
    found = [
        f"reduces chi-square by {law['chi_square']:.0f} and improves −2 log evidence by {significant(law['better_by'], 4)}; "
        f"in noise alone a search finds as much with {chance}",
        *(held_out_words(each) for each in law["held_out"]),
    ]
    if law.get("not_observed"):
        words = "; ".join(each["in_words"] for each in law["not_observed"])
        found.append(f"not observed in this recording, set to zero and not applied: {words}")
    if (factor := law["learnable_from"]) is not None:
        size = f"from {significant(factor, 2)} of its size on" if factor <= 1 else f"only from {significant(factor, 2)} times its size on"
        found.append(f"in 19 of 20 draws of noise this search finds it here {size}")
    return found


def number_lines(law: dict) -> list[str]:
    """``x 0.0210 ± 0.0020   y … dps``, and a line for each constant."""
    lines: list[str] = []
    for name, values in law["parameters"].items():
        rows = values if values and isinstance(values[0], list) else [values]
        spreads = law["std"][name] if rows is values else [law["std"][name]]
        heads = _heads(rows, law.get("terms", []))
        for row, spread, labels in zip(rows, spreads, heads, strict=True):
            numbers = "   ".join(f"{label}{measured(*each)}" for label, *each in zip(labels, row, spread, strict=True))
            head = f"{name}: " if name == law["unit"] else f"{name} ({law['unit']}): "
            lines.append(f"{head if not lines else ' ' * len(head)}{numbers}")
    for name, constant in law["constants"].items():
        unit = "of full scale" if constant["unit"] == "fraction" else constant["unit"]
        # ``width`` of ``width_share``
        ending = next((f"_{unit}" for *_, unit in UNITS.values() if name.endswith(f"_{unit}")), "")
        lines.append(f"{name.removesuffix(ending).replace('_', ' ')}: {measured(constant['value'], constant['sigma'])} {unit}")
    return lines


def _heads(rows: list, terms: list[str]) -> list[list[str]]:
    """The label before each number: empty where there is one for each axis; ``x ← y `` for a row's first, then ``z ``."""
    if len(rows) == 1:
        return [[""] * len(rows[0])]
    given, heads = iter(terms), []
    for row in rows:
        own = [next(given, "") for _ in row]
        axis, arrow, _ = own[0].partition(ARROW)
        heads.append([f"{axis}{arrow}" * (not number) + f"{each.removeprefix(f'{axis}{arrow}')} " for number, each in enumerate(own)])
    return heads


def abbreviated(table: dict) -> str:
    """Definitions of the page's abbreviations that its equations do not define themselves."""
    texts = [law["equation"] for law in table["laws"]]
    others = [text for law in table["laws"] for text in (*law["same_here"][:MOST_SAME], *(each["equation"] for each in law["runners_up"]))]
    return "; ".join(meaning for meaning in abbreviations(" ".join([*texts, *others])) if not any(meaning in text for text in texts))


def held_out_words(each: dict) -> str:
    """Closure of held-out segments, before and after."""
    of = f"{each['segments']} held-out segments"
    if each["recording"]:
        of = f"{each['recording']}, left out whole ({each['segments']} segments)"
    gone = "" if each["removed"] is None else f"; {100 * each['removed']:.1f} % of the excess removed"
    closure = f"closure {each['before_deg']:.4f}° -> {each['after_deg']:.4f}°, noise alone {each['floor_deg']:.4f}°{gone}"
    left = f"; the rest is more than the sensor's own noise ({probability(each['noise_p'])})" if each["noise_p"] < NOISE_P else ""
    return f"{of}: {closure} ({probability(each['p_value'])}){left}"


def open_words(law: dict) -> list[str]:
    """Forms that this recording cannot distinguish from a law; alternatives: equation, evidence against it, correlation with the law, and
    what would discriminate."""
    same = [briefly(text) for text in law["same_here"]]
    more = f"; … ({len(same)})" if len(same) > MOST_SAME else ""
    found = [f"equivalent in this recording: {'; '.join(same[:MOST_SAME])}{more}"] if same else []
    for each in law["runners_up"][:MOST_RUNNERS_UP]:
        name = f"{each['id']}  " if each["id"] else ""
        worse = f"worse by {significant(each['worse_by'])}, correlation {each['correlation']:.3f}"
        found.append(f"alternative: {name}{briefly(each['equation'])} ({worse}): {each['discriminating_motion']}")
    return found


def _learnable(learnable: dict) -> str:
    known = [(_quantity(name), each["size_dps"]) for name, each in learnable.items() if each["size_dps"] is not None]
    blind = [_quantity(name) for name, each in learnable.items() if each["size_dps"] is None]
    known.sort(key=lambda pair: pair[1])
    texts = ", ".join(f"{name} from {significant(size, 2)}" for name, size in known[:MOST_LEARNABLE])
    lines = [f"a law of one quantity alone would be found in 19 of 20 such recordings from so many dps rms on: {texts}"] if known else []
    return "; ".join(lines + ([f"not detectable here: {', '.join(blind)}"] if blind else []))


def _quantity(name: str) -> str:
    return QUANTITIES[name].words.split(",")[0]
