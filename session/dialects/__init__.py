"""Logs of other programs and devices, as they lie on an SD card.

``table``    what is known: one small entry for each dialect
``units``    units as people write them
``layout``   a file's header line -> which column is what (or what must be asked)
``stamps``   time, exact until it is a difference
``reader``   a file's rows in pieces, SI
``convert``  one file, or two joined on time -> a session folder

No file tells everything.  What is missing is asked for in one line that names the option.
"""
