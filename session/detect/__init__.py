"""What is found in samples: stills, segments, clipping, the pace of the stamps, rests.

May import: common, sensor, log.
"""
