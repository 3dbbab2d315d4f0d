"""Calibration over temperature: the zero from rest logs, and with sessions the whole calibration."""
