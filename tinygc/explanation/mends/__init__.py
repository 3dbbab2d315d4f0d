"""What the registers and stills themselves show to be wrong, and the recording without it."""
