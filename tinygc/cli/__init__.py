"""The command line: arguments, and a file for each command."""
