"""An accelerometer's own calibration, from the stills of a recording.

May import: common, files, log, detect.
"""
