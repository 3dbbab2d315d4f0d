"""Kept for the tests that ask for it by this name."""

from fleets import written_fleet

__all__ = ["written_fleet"]
