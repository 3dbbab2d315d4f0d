"""The known sensors, a file for each maker.  A new one is a record, and its row of docs/sensors.md.

A source that begins with a document or driver was read, there or where it is quoted; "remembered" was not, and says so in the listing.
"""
