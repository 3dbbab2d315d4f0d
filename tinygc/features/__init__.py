"""What the core does not know: a folder each, which may be removed."""
