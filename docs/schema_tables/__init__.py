"""What each JSON of the tool holds, key by key: the tables that ``docs/make_schemas.py`` writes as JSON Schema.

A file here is a page of ``docs/formats``; tests hold the two against each other, and both against what the commands write.
"""
