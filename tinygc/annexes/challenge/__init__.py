"""``calibrate.py challenge``: the tool's own blind examination, for whoever doubts it."""
