"""Truth files: attitudes from elsewhere as the reference of a recording."""
