"""All parts of the proof of an effect, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import TYPE_CHECKING

from session.common.errors import CalibrationError
from tinygc.effect_checks import device, forms, live, numbers
from tinygc.effect_checks.picture import picture
from tinygc.effect_checks.recover import recover
from tinygc.effect_checks.report import FAILED, NOT_CHECKED, PASSED, NotChecked, Part, Report, Wrong
from tinygc.effect_checks.scene import SIZE, trial
from tinygc.effect_checks.sessions import explanation_of
from tinygc.effects import Effect, EffectError
from tinygc.effects.trial import tried
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from tinygc.effect_checks.sessions import Found

PARTS = ("columns", "undo", "recover", "units", "picture", "live", "c")


def check(
    effect: Effect,
    *,
    size: float | None = None,
    value: float | None = None,
    seeds: int = 3,
    explanation: Explanation | None = None,
    parts: Sequence[str] = PARTS,
) -> Report:
    """See ``tinygc.effects.testing.check``."""
    if unknown := [name for name in parts if name not in PARTS]:
        raise EffectError(f"{unknown[0]!r} is no part of a check; choose among {', '.join(PARTS)}")
    tried(effect, "check")
    if size is not None and not (size > 0 and isfinite(size)):
        raise EffectError(f"size is {size!r}, expected more than 0, in SI units: the size of the injected parameters")
    if seeds < 1:
        raise EffectError(f"seeds is {seeds!r}, expected 1 or more: the number of simulated sessions")
    size = SIZE * effect.parameter.plausible if size is None else size
    strong = trial(effect, size, 1, value)
    found = []

    def recovered() -> str:
        says, first = recover(effect, size, seeds, value)
        found.append(first)
        return says

    def drawn() -> str:
        shown = explanation
        if shown is None and effect.kind in ("rate", "force", "earth"):
            if not found:
                found.append(recover_one(effect, size, value))
            shown = explanation_of(found[0])
        return picture(effect, shown)

    run: dict[str, Callable[[], str]] = {
        "columns": lambda: forms.columns(strong),
        "undo": lambda: forms.undo(strong),
        "recover": recovered,
        "units": lambda: numbers.units(strong),
        "picture": drawn,
        "live": lambda: live.live(strong),
        "c": lambda: device.c(strong),
    }
    return Report(effect.id, tuple(_part(name, run[name]) for name in PARTS if name in parts))


def recover_one(effect: Effect, size: float, value: float | None) -> Found:
    """One session with the effect, fitted, whatever comes of it."""
    import tempfile
    from pathlib import Path

    from tinygc.effect_checks.sessions import fitted, inject

    with tempfile.TemporaryDirectory() as folder:
        return fitted(effect, inject(effect, Path(folder) / "1", size, 1, value))


def _part(name: str, run: Callable[[], str]) -> Part:
    try:
        return Part(name, PASSED, run())
    except NotChecked as why:
        return Part(name, NOT_CHECKED, str(why))
    except (Wrong, CalibrationError) as wrong:
        return Part(name, FAILED, str(wrong))
    except Exception as error:  # the effect's own code is on trial: whatever it raises is a failure of this part
        return Part(name, FAILED, f"{type(error).__name__}: {' '.join(str(error).split())}")
