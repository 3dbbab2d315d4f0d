"""What a sensor's registers mean, what sensors of known models typically read, and what no sensor measures.

May import: common.
"""
