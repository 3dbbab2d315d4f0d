"""Explain why a recording differs from the simulation (docs/explain.md): detect, locate, name, reject, refit, prove."""
