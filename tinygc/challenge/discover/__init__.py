"""``calibrate.py challenge --discover``: is a law that stands in no catalogue found, written down right, and refused where there is none?

``laws`` makes what is hidden, from physics alone: nothing here reads the grammar of the search.  ``cases`` draws what each session
hides; ``truth`` is what it adds to the rate; ``answer`` reads what was said, and what that adds; ``score`` compares the two as curves
over the recording; ``tables`` prints; ``examine`` is all of it in order.
"""
