"""``calibrate.py report``: a session's calibration as one HTML file that needs nothing else."""
