"""Public Python interface, used by the command line as well: functions take a session and return a result."""
