"""Which movements to record next: the plan of a session, and the coach during recording."""
