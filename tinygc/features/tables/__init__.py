"""Sessions that a machine turns: the next move computed, a virtual bench, and the table's own errors separated from the sensor's."""
