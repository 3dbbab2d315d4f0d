"""A page to look at while turning: the guide's state in a browser, live.  The recording never waits for a browser; what one
may ask for are the terminal's keys (``wishes``).

``view.PageView`` is told what the screen is told; ``attitude`` follows the board, ``state`` puts it into JSON, ``server`` sends it to
whoever knows the address (a ``handler`` a connection), ``files`` are the page.

May import: common, log, guide.
"""
