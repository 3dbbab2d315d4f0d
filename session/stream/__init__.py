"""What a board sends, byte by byte, turned into samples: text lines or ``tinygc-frame/1`` (docs/formats.md, serial stream).

``decoder.StreamDecoder`` takes bytes and gives ``events``.  It needs no port, no clock and no file, and what it gives depends on
the bytes alone, not on how they were cut: a recording replays to the same samples.

May import: common.
"""
