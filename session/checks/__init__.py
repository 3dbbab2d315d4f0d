"""The first look, an idea a file; ``session.checks.first_look`` puts them together."""
