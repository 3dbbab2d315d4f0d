"""Thousands of session folders: each is computed once, here or on a cluster, and kept in one table."""
