"""Build the firmware, and run it under QEMU.  ``tools_missing`` names what is not installed; everything else expects the tools."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

FIRMWARE = Path(__file__).resolve().parent.parent
TOOLS = ("make", "arm-none-eabi-gcc", "qemu-system-arm")
MACHINE = ("-M", "netduinoplus2", "-display", "none", "-monitor", "none")
RUN_S = 600  #: of some 5 s on a machine that does nothing else


class Symbol(NamedTuple):
    """A line of ``nm``: its kind is a letter; size in bytes, 0 where it has none."""

    name: str
    kind: str
    address: int
    size: int


class Sizes(NamedTuple):
    """Bytes: code (all functions but the self-test), weights (constants but its vectors), self_test (both), state."""

    code: int
    weights: int
    self_test: int
    state: int


@dataclass(frozen=True, eq=False)
class Measured:
    """rates (N, 3) float32 rad/s; instructions a sample, with the loop around it; per_nop, which shows whether they are instructions;
    self_test: 0 where it passed; exact: whether no bit of its answers differed."""

    rates: np.ndarray
    instructions: float
    per_nop: float
    self_test: int
    exact: bool


def tools_missing() -> str:
    """Empty, or what to install."""
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if not missing:
        found = subprocess.run(["arm-none-eabi-gcc", "-print-file-name=nano.specs"], capture_output=True, text=True, check=False)
        missing = [] if "/" in found.stdout else ["libnewlib-arm-none-eabi"]
    return f"not installed: {', '.join(missing)} (docs/firmware.md)" if missing else ""


def build(target: str, model: Path, folder: Path, optimise: str = "-O2", **variables: str) -> Path:
    """A target of the Makefile, of the model in a folder.  Raises RuntimeError with the output of make."""
    settings = {"MODEL": model.resolve(), "BUILD": folder.resolve(), "OPTIMISE": optimise, **variables}
    command = ["make", "-s", "-C", FIRMWARE, target, *(f"{name}={value}" for name, value in settings.items())]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        raise RuntimeError(made.stdout + made.stderr)
    return folder / target


def symbols(path: Path) -> list[Symbol]:
    """Of a program or an object file."""
    table = subprocess.run(["arm-none-eabi-nm", "-S", path], capture_output=True, text=True, check=True).stdout
    rows = re.findall(r"^(\w+) (?:(\w{2,}) )?(\w) (\S+)$", table, re.M)
    return [Symbol(name, kind, int(address, 16), int(size or "0", 16)) for address, size, kind, name in rows]


def sizes(folder: Path) -> Sizes:
    """Of the ``tinygc_model.o`` in a build folder."""
    found = symbols(folder / "tinygc_model.o")
    test = [symbol for symbol in found if symbol.name == "tinygc_self_test" or symbol.name.startswith("TEST_")]
    use = [symbol for symbol in found if symbol not in test]
    # The measuring program holds one state; its size as the linker sees it.
    (state,) = [symbol for symbol in symbols(folder / "measure.elf") if symbol.kind in "bB" and symbol.name.split(".")[0] == "state"]
    code, weights = (sum(symbol.size for symbol in use if symbol.kind in kinds) for kinds in ("tT", "rR"))
    return Sizes(code, weights, sum(symbol.size for symbol in test), state.size)


def run(elf: Path, inputs: np.ndarray, folder: Path) -> Measured:
    """Feed (N, 7) gx gy gz rad/s, ax ay az m/s^2, temperature degC to measure.elf under QEMU, an instruction a nanosecond."""
    inputs.astype("<f4").tofile(folder / "inputs.bin")
    semihosting = ("-semihosting-config", "enable=on,target=native")
    command = ["qemu-system-arm", *MACHINE, "-serial", "none", "-icount", "shift=0", *semihosting, "-kernel", elf.resolve()]
    # Semihosting prints to standard error.
    ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=RUN_S, check=False)
    output = ran.stderr.split()
    if ran.returncode or len(output) != 5 or int(output[0]) != len(inputs):
        raise RuntimeError(f"the board printed {ran.stderr.strip()[-300:]!r}; expected {len(inputs)} samples and four numbers")
    samples, ticks, nops, failed, inexact = map(int, output)
    rates = np.fromfile(folder / "outputs.bin", "<f4").reshape(-1, 3)
    return Measured(rates, ticks / samples, nops / 1000, failed, not inexact)


def ports_under_qemu(elf: Path, start: Callable[..., subprocess.Popen]) -> tuple[str, ...]:
    """The pseudo-terminals of the host and of the sensor of a board that ``start``, as ``subprocess.Popen`` does, lets run."""
    command = ["qemu-system-arm", *MACHINE, "-serial", "pty", "-serial", "pty", "-kernel", str(elf)]
    process = start(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    return tuple(re.search(r"/dev/\S+", process.stdout.readline())[0] for _ in range(2))
