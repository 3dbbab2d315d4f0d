"""The fit of a session from its inputs to its files, and what is made of fitted sessions."""
