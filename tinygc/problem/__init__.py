"""From a session to what every method solves: stills with attitudes, segments, batches, the Earth, closure runs.

May import: session, attitude, effects, models, lot, closure.
"""
