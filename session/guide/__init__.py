"""The guide: what one person at the table is to do now, and why it waits.  Runs on samples alone: no clock, no terminal, no port.

May import: common, sensor, stream, dialects, log, detect, accelerometer, recording.
"""
