"""``calibrate.py report``: a session's calibration as one HTML file that needs nothing else.

    evidence.py      runs fit and explain (or takes what fit has saved), and measures what a report states besides
    adopted.py       which calibration is reported: the linear one, or the one with the physics that was named
    decision.py      pass or fail, and by which rule
    sections/        a file each: what is said and drawn
    chart.py, sphere.py, triad.py   SVG, written by hand, in the page's own colours
    numbers.py, markup.py, style.py, page.py   how numbers, tables and the page are written

Everything that comes from a file is escaped where it enters the page.
"""
