"""What a Python user calls, and the command line as well: a session in, a result out."""
