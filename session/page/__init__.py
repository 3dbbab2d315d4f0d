"""A page to look at while turning: the guide's state in a browser on this computer, live.  It only reads: nothing that a browser does
reaches the recording.

``view.PageView`` is told what the screen is told; ``attitude`` follows the board, ``state`` puts it into JSON, ``server`` sends it to
whoever knows the address, ``files`` are the page.

May import: common, log, guide.
"""
