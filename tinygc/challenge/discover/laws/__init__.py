"""Gyroscope error laws that stand in no catalogue, a file each family, and laws drawn at random from a wide grammar.

Each is a ``Maker``: it bends the true rate on the simulation's fine grid, SI.  Strong sizes are those of a poor sensor or of a careless
set-up: what a law adds beyond a linear calibration is 0.05 to 0.3 dps rms, where its source does not say otherwise.  Each parameter is
0.5 to 1.5 times as large, of either sign.
"""
