"""From a port to a recorded session: bytes, samples, files, and the guide for the person at the table."""
