"""A lot on an HTML page.

``sections.py`` has what a page says of a lot, for ``fleet``'s page or one of its own; ``charts.py`` draws control charts, and ``page.py``
makes the page of ``calibrate.py lot``.
"""
