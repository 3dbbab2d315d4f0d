"""What the fit of a session may claim: its tests, its limits, and whether it passes."""
