"""The commands of ``calibrate.py``, a file each, in the order of ``--help``.

A command's file has ``SUMMARY`` (one line), ``add_arguments(command)`` and ``run(args)``, which returns the exit code.  It imports
nothing heavy at its top: ``--help`` is instant.  ``USES_EFFECTS = True`` gives it ``--effects DIR``; ``DEFAULTS`` says which of
its arguments, left open, a person's own file fills in (``tinygc/cli/defaults.py``).  A new command is a new file, named
below.
"""

COMMANDS = (
    "sensors",
    "ports",
    "board",
    "record",
    "replay",
    "list",
    "check",
    "accelerometer",
    "fit",
    "explain",
    "report",
    "plan",
    "apply",
    "export",
    "compare",
    "fleet",
    "lot",
    "challenge",
    "simulate",
    "completion",
)
