"""What every other folder of the bench side uses: errors, units, registers, files that are written whole.

May import: nothing.
"""
