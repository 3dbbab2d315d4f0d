"""Recordings of several units on one rigid body."""
