"""The uncertainty by source."""
