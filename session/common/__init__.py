"""What every other folder uses: errors, units, the version, and two idioms of arrays (runs of a mask, a scatter from medians).

May import: nothing.
"""
