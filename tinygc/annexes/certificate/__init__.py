"""Certificates of calibration."""
