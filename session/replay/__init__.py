"""Session folders of what a logger wrote to its card, or of a recording's raw bytes.

May import: common, dialects, log, checks, stream, recording.
"""
