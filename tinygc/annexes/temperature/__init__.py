"""A gyroscope over temperature: its zero from rest logs, and with sessions its whole calibration."""
