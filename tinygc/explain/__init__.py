"""Why the recording differs from the simulation (DESIGN, explaining a mismatch): detect, locate, name, refuse, refit, prove."""
