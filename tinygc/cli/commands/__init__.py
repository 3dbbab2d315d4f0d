"""The commands of ``calibrate.py``, a file each, in the order of ``--help``.

A command's file has ``SUMMARY`` (one line), ``add_arguments(command)`` and ``run(args)``, which returns the exit code.  It imports
nothing heavy at its top: ``--help`` is instant.  ``USES_EFFECTS = True`` gives it ``--effects DIR``; ``DEFAULTS`` says which of
its arguments, left open, a person's own file fills in (``tinygc/cli/defaults.py``).  A new command is a new file, named
below.
"""

COMMANDS = {
    "sensors": "tinygc.cli.commands.sensors",
    "ports": "tinygc.cli.commands.ports",
    "board": "tinygc.cli.commands.board",
    "record": "tinygc.cli.commands.record",
    "replay": "tinygc.cli.commands.replay",
    "list": "tinygc.cli.commands.list",
    "check": "tinygc.cli.commands.check",
    "accelerometer": "tinygc.cli.commands.accelerometer",
    "fit": "tinygc.cli.commands.fit",
    "explain": "tinygc.cli.commands.explain",
    "report": "tinygc.cli.commands.report",
    "plan": "tinygc.cli.commands.plan",
    "apply": "tinygc.cli.commands.apply",
    "export": "tinygc.cli.commands.export",
    "compare": "tinygc.cli.commands.compare",
    "fleet": "tinygc.annexes.lots.fleet_command",
    "lot": "tinygc.annexes.lots.command",
    "challenge": "tinygc.annexes.challenge.command",
    "simulate": "tinygc.cli.commands.simulate",
    "completion": "tinygc.cli.commands.completion",
}
