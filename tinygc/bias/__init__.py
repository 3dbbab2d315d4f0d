"""The bias of the day: from the first still, from gravity, over several days."""
