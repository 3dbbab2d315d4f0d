"""What the bench side's core does not know: a folder each, which may be removed."""
