"""Files: opened in one place and within bounds, read with one line for all that can be wrong; results written whole or not at all, named in
every failure to write.

May import: common.
"""
