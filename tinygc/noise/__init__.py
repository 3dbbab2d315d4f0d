"""The digital twin, which predicts every channel, and the noise of a recording as variance components."""
