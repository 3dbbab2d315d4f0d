"""Many units of one kind: how a lot's parameters are spread, drift and repeat, which units do not belong, and what that tells of the next.

May import: session, models.
"""
