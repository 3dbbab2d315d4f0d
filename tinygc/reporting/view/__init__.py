"""The page of a recording: its curves over time, stills, segments, closure, and what was changed by hand."""
