"""The calibration subnet: the paper's, the authors' published one, the one with conditions; training and files."""
