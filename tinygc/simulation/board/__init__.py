"""A board that nobody soldered: a session, simulated or recorded, streamed through a pseudo-terminal as an ASM330LHH board would.

``source`` (what the sensor reads, sample by sample) -> ``faults`` (what the wire does to it) -> ``terminal`` (a pseudo-terminal that
never blocks) ; ``board`` paces them by the clock.  For trying the recorder without hardware, and for its tests.
"""
