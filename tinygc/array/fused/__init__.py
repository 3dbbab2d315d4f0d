"""All units as one gyroscope: the best weights, the model and its file."""
