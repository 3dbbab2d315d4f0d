"""The first look, an idea a file; ``first_look`` puts them together.

May import: common, sensor, log, detect, accelerometer, alignment.
"""
