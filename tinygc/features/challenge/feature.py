"""The tool's blind examination, and the proof of an effect."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "challenge": ("command", "examine explain on sessions that conceal one to three effects, blind"),
    },
    serves={"proof of an effect": "proofs:check"},
)
