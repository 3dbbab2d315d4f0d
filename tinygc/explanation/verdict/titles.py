"""What a verdict and a channel are called."""

from __future__ import annotations

VERDICTS = {
    "no_mismatch": ("nothing is missing: noise explains all that differs", "green"),
    "explained": ("explained", "green"),
    "ambiguous": ("explained, but this recording cannot decide between lookalikes", "yellow"),
    "partly_explained": ("partly explained: something is left that has no name here", "yellow"),
    "unexplained": ("there is a mismatch, and no effect in the catalogue fits it", "red"),
}


CHANNELS = {"closure": "closure of each segment", "still": "mean rate in each still", "length": "length of gravity in each still"}
