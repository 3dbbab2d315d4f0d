"""``explain`` where the reference is a truth file: a folder of its own, since the twin of the stills has no part in it."""
