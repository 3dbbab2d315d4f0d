"""``explain`` where the reference is a truth file: a folder of its own, with a twin of its own: the closure between moments of truth, no stills."""
