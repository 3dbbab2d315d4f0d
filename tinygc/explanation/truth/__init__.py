"""``explain`` where the reference is a truth file: a folder of its own, whose twin has no stills, only the closure between moments."""
