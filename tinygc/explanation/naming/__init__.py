"""Which effects of the catalogue the channels ask for, what could stand in for them, and what has no name."""
