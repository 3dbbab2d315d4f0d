"""The tool's blind examination, and the proof of an effect."""

from session.base.features import Feature

FEATURE = Feature(
    commands={
        "challenge": ("command", "test explain on sessions with concealed effects", "try"),
    },
    serves={"proof of an effect": "proofs:check"},
)
