"""Calibration of a gyroscope alone, by turns of known angle: scale and bias about each axis that was turned, sense by sense."""
