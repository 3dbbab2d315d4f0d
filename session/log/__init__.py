"""Files, units, sensors and logs: a session folder as plain records in SI."""
