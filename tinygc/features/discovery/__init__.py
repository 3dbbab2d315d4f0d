"""Equation search beyond the catalogue (docs/discover.md): find the missing equation and write it as an effect file."""
