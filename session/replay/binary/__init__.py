"""Binary logs: a reader for each format, over the library that the format's community keeps."""
