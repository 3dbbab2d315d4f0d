"""docs/formats/verify.md: what ``verify`` says of a stored calibration."""

from __future__ import annotations

from .shapes import COUNT, FLAG, NUMBER, SHARE, SIZE, TEXT, VECTOR, maybe, of, words

_QUESTION = {
    "name": words("E", "B", "gravity's length", "noise"),
    "asked": FLAG,
    "holds": maybe(FLAG),
    "statistic": maybe(SIZE),
    "chi_square?": maybe(SIZE),
    "freedom": COUNT,
    "p_value": maybe(SHARE),
    "level": SHARE,
}
_CAUSE = {
    "names": [TEXT],
    "words": [TEXT],
    "probability": SHARE,
    "instead": [{"name": TEXT, "others": [TEXT]}],
    "alone": [{"name": TEXT, "log_odds": NUMBER}],
}
TABLES = {
    "tinygc-verify/1": {
        "version": TEXT,
        "model": TEXT,
        "of": TEXT,
        "today": TEXT,
        "answer": words("holds", "holds for E, take B anew", "does not hold", "undecided"),
        "headline": TEXT,
        "advice": TEXT,
        "exit_code": COUNT,
        "alarm": FLAG,
        "false_alarm": SHARE,
        "turns": COUNT,
        "rests": COUNT,
        "questions": [_QUESTION],
        "expected": [{"name": TEXT, "source": TEXT, "freedom": maybe(SIZE), "assumed": FLAG}],
        "bias_anew": {"bias_dps": VECTOR, "change_dps": VECTOR, "sigma_dps": VECTOR},
        "cause": maybe(_CAUSE),
        "cost": {"motion": TEXT, "as_it_is_deg": VECTOR, "sigma_deg": VECTOR, "bias_anew_deg": VECTOR, "bias_anew_sigma_deg": VECTOR},
        "bounds": [of("tinygc.features.unit.verification.cost:Bound")],
        "turns_that_tell": [TEXT],
        "turns_that_separate": [TEXT],
        "facts": [TEXT],
        "notes": [TEXT],
    },
}
