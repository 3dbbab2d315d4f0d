"""Rate steps of a rate table: scale, offset, nonlinearity, clipping, each with its sigma (IEEE 1431, 12.9 to 12.11)."""
