"""A session folder as plain records: session.toml, logs, closure runs, dial readings, truth files.

May import: common, files, sensor, dialects.
"""
