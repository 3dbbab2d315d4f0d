"""Session folders of what a logger wrote to its card (``convert``), or of a recording's raw bytes (``from_raw``)."""
