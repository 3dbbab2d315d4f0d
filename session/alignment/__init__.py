"""A truth file against its log: clock, frame and mounting, found out from gravity and from the gyro's rates.

May import: common, log, detect.
"""
