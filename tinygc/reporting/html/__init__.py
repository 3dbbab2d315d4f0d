"""``calibrate.py report``: a session's calibration as one self-contained HTML file."""
