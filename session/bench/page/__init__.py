"""A page to look at while turning: the guide's state in a browser, live.  The recording never waits for a browser."""
