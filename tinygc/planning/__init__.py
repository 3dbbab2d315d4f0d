"""Which movements to record next: the plan of a session, and the coach at the table."""
