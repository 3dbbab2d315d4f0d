"""A form's constants by name."""

from __future__ import annotations

from tinygc.discovery.grammar.form import Form


def constant_names(form: Form) -> list[tuple[str, str]]:
    """(name in the JSON, unit) of each of ``form.constants``, in their order: ``rate_threshold``, ``temperature_lag``."""
    found: list[tuple[str, str]] = []
    for factor in form.factors:
        if factor.constant is not None:
            found.append((f"{factor.quantity}_{factor.through.constant or 'constant'}", factor.of.unit))
        if factor.lag_s is not None:
            found.append((f"{factor.quantity}_lag", "s"))
    names = [name for name, _ in found]
    return [(name if names.index(name) == at else f"{name}_{at + 1}", unit) for at, (name, unit) in enumerate(found)]
