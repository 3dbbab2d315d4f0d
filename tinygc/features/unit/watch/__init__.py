"""A calibration that is watched while it is used."""
