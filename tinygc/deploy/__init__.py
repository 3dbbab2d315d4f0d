"""Models in use: live streams, logs of any length, exports for other programs, C for a microcontroller."""
