"""Several simulated units on one rigid body: one motion, and of each unit its own place, clock, errors and noise."""
