"""Sessions that a machine turns: the next move computed, a virtual bench, and the table's own errors told from the sensor's."""
