"""Why the recording differs from the simulation (docs/explain.md): detect, locate, name, refuse, refit, prove."""
