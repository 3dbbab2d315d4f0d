"""Equation search beyond the catalogue (docs/features/discovery/discover.md): find the missing equation and write it as an effect file."""
