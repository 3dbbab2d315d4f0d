"""The first look, an idea a file; ``session.check`` puts them together."""
