"""What white noise does not cover, as variance components with names, sizes and uncertainties, estimated from the recording itself."""
