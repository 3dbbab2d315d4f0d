"""The one reader of logs: a standard log of a session, and logs of other programs and devices as they lie on an SD card.

``units``      the one table of units, as people write them
``layout``     the records: which column is what, and what a person answers
``standard``   the header line of a standard log (FORMATS) -> a layout
``table``      what is known of others: one small entry for each dialect
``columns``    any CSV at all, as ``--columns`` says
``recognise``  a file's first lines -> a layout, or one line that asks for what no file tells, in the words of the options
``stamps``     time, exact until it is a difference
``lines``      a text file's lines, plain or gzipped, in pieces and within bounds
``rows``       lines -> numbers, or what is wrong with which line
``reader``     all of it: a file's rows, in pieces

May import: common, files, sensor.
"""
