"""The digital twin: what the present physics predicts of every channel, and what the recording has beyond it."""
