"""``calibrate.py challenge``: a blind test of the tool that anyone can run."""
