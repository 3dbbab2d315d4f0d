"""From names to an explanation: refuse, prove on segments never seen, say where, what, and what to do next."""
