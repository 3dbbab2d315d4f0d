"""Many units of one kind: spread, drift, repeatability, and the prior they give for the next unit."""
