"""What is found in samples: stills, segments, clipping, the accelerometer's numbers, and the first look."""
