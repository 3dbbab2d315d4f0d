"""Files of results: read with one line for all that can be wrong, written whole or not at all, named in every failure to write.

May import: common.
"""
