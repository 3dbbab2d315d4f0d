"""How long readings have waited for their reader, where sensors sample by clocks of their own; turns of each unit against the mean."""
