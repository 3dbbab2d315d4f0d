"""The twin that predicts every channel, and the noise of a recording as variance components."""
