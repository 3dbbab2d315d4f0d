"""The noise of a sensor at rest, from milliseconds to hours: terms by likelihood, with sigmas; what a filter makes of them."""
