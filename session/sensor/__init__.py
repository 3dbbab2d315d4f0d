"""What a sensor's registers mean, and what no sensor measures.

May import: common.
"""
