"""A form in words: its equation, a sentence, a name for files, and what would show it best."""

from __future__ import annotations

from tinygc.discovery.grammar.form import Factor, Form

#: what to change on purpose, for each quantity
SPLITS = {
    "rate": "turn about each axis slowly and fast, in both senses",
    "rate_size": "turn slowly and fast",
    "force": "hold stills in many attitudes, each axis up and down",
    "acceleration": "start and stop turns softly and briskly",
    "jerk": "start and stop turns softly and briskly",
    "temperature": "let the sensor warm up, and cool, while you record",
    "temperature_rate": "change the temperature fast, and then hold it",
    "time": "record again, begun at another time after switch-on",
    "rest": "rest for a second, for ten, and for a minute between turns",
    "vibration": "repeat the same turns with and without the vibration",
    "turned": "turn one axis on and on in one sense, then back",
    "sense": "turn each axis several times in one sense, then in the other",
    "level": "hold the same attitudes pointing north, east, south and west",
}


def _shown(factor: Factor, index: str) -> str:
    symbol = factor.of.symbol.replace("{i}", index)
    unit = "" if factor.of.unit == "1" else f" {factor.of.unit}"
    constant = "" if factor.constant is None else f"{factor.constant:.4g}{unit}"
    shown = factor.through.shown.replace("{x}", symbol).replace("{c}", constant)
    return shown if factor.lag_s is None else f"lag({shown}, {factor.lag_s:.3g} s)"


def equation(form: Form) -> str:
    """One line, constants in people's units."""
    if form.pattern == "leant":
        first, second = form.factors
        return f"ω_i += {_shown(first, 'i')} Σ_j C_ij {_shown(second, 'j')}, u = ω / FS"
    if form.pattern in ("next", "last"):
        indices = ("j", "k") if form.pattern == "next" else ("k", "j")
        product = " ".join(_shown(factor, index) for factor, index in zip(form.factors, indices, strict=True))
        return f"ω_i += c_i {product}, i, j, k in turn, u = ω / FS"
    index = "i" if form.pattern == "each" else "j"
    product = " ".join(_shown(factor, index) for factor in form.factors)
    vector = any(factor.vector for factor in form.factors)
    sums = {"each": "c_i", "full": "Σ_j C_ij", "cross": "Σ_j≠i C_ij"}[form.pattern]
    return f"ω{'_i' if vector else ''} += {sums if vector else 'c'} {product}" + (", u = ω / FS" if "u" in product else "")


def what(form: Form) -> str:
    """A name for an id and a file, at most 40 characters."""
    parts = []
    for factor in form.factors:
        plain = [] if factor.function == "itself" else [factor.function]
        late = [] if factor.lag_s is None else ["lagged"]
        parts.append("_".join([*late, *plain, factor.quantity]))
    tail = "" if form.pattern == "each" else f"_{form.pattern}"
    return "_".join(parts)[: 40 - len(tail)].rstrip("_") + tail


def splits(form: Form) -> str:
    """The movements or conditions that would show it best."""
    return "; ".join(dict.fromkeys(SPLITS[factor.quantity] for factor in form.factors))
