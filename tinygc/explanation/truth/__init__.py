"""``explain`` where the reference is a truth file, with a twin of its own: the closure between moments of truth, no stills."""
