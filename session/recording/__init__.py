"""From a port to files: raw bytes first, then the log that is parsed from them.

``recorder.Recorder`` is the whole of it: a reader thread (``port``), the raw file (``rawfile``), the decoder, the logs
(``logwriter``).  ``decoding`` makes the same logs again from the raw file, bit for bit.

May import: common, files, sensor, stream, log.
"""
