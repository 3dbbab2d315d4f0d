"""Public recordings as session folders, from their authors' own files.

``python -m session.public NAME DIR`` makes them; docs/real-recordings.md says where the files come from.

May import: common, files, log, accelerometer.
"""
