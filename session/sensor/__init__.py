"""What a sensor's registers mean, what sensors of known models typically read, and what no sensor measures.

``profiles``   a record for each known sensor, by maker
``known``      which of them a name means
``registers``  counts -> SI, and back
``plausible``  what no sensor measures

May import: common.
"""
