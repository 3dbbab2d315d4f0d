"""``ports``: list the serial ports, likely boards first."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from session.base.texts import command_line
from tinygc.cli.results import output, print_commands, write_json

SUMMARY = "list the serial ports, and say which may be the board"


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add no arguments but the common ones."""


def run(args: argparse.Namespace) -> int:
    """List the serial ports, candidates first."""
    from session.bench.port import known_ports

    ports = known_ports()
    for port in ports:
        usb = "" if port.usb is None else f"  USB {port.usb[0]:04x}:{port.usb[1]:04x}"
        serial = "" if port.serial_number is None else f"  S/N {port.serial_number}"
        output(args).print(f"{port.name}  {port.what}{usb}{serial}", soft_wrap=True)
    if not any(port.is_candidate for port in ports):
        print_commands(args, "no board: plug one in, or start a virtual one with", command_line("board"))
    write_json(args.json, {"schema": "tinygc-ports/1", "ports": [asdict(port) for port in ports]})
    return 0
