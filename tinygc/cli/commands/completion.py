"""``completion``: print a shell's script for completing commands and options with the Tab key."""

from __future__ import annotations

import argparse
import sys

from tinygc.cli.arguments import is_standard_output
from tinygc.cli.completion import SHELLS, script
from tinygc.cli.results import standard_output, write_json

SUMMARY = "print what makes bash, zsh or fish complete commands and options"
EPILOG = """bash: calibrate.py completion bash >> ~/.bashrc.  zsh: calibrate.py completion zsh >> ~/.zshrc (behind compinit).
fish: calibrate.py completion fish > ~/.config/fish/completions/calibrate.fish.  Completed is what begins with calibrate or calibrate.py."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.epilog = EPILOG
    command.add_argument("shell", choices=SHELLS, help="which one")


def run(args: argparse.Namespace) -> int:
    """Print the script on standard output."""
    from tinygc.cli.arguments import parser

    text = script(args.shell, parser())
    if not is_standard_output(args.json):
        with standard_output():
            sys.stdout.write(text)
    write_json(args.json, {"schema": "tinygc-completion/1", "shell": args.shell, "script": text})
    return 0
