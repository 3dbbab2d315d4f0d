"""The worst-case stack of a program, from the call graph that ``-fcallgraph-info=su`` leaves in a .ci file beside each object.

Which objects were linked stands in the linker's map (``-Wl,-Map``) beside the program: other programs may have left theirs in the folder.

Each function's own bytes are the compiler's; those of the C library's functions are counted from their disassembly.  A call through a
pointer may lead to every function whose address the program holds.  Recursion, and a frame without a bound, are errors.

All interrupts have one priority, so that none interrupts another; a fault of the core interrupts all.
"""

from __future__ import annotations

import re
import struct
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import measure

PREFIX = "arm-none-eabi-"
VECTORS = 98  #: words at the program's beginning
EXCEPTION_BYTES = 4 * 26 + 4  #: the core's own frame with the registers of the FPU, and what aligns it
INDIRECT = "__indirect_call"
RESET, FAULT, FAULT_BODY = "Reset_Handler", "HardFault_Handler", "fault.c:on_fault"  #: the last is entered by a jump of the one before


class StackError(ValueError):
    """Raised where a program's stack has no bound."""


@dataclass
class Graph:
    """own: function -> bytes of its frame; calls: function -> functions that it calls, or INDIRECT."""

    own: dict[str, int] = field(default_factory=dict)
    calls: dict[str, set[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Stack:
    """Bytes: main (from reset), interrupt and fault (each with the core's frame), reserved by the linker; deepest: functions of the longest
    path from reset."""

    main: int
    interrupt: int
    fault: int
    reserved: int
    deepest: tuple[str, ...]

    @property
    def total(self) -> int:
        """Main, interrupted at its deepest by an interrupt that faults at its own."""
        return self.main + self.interrupt + self.fault


def stack(elf: Path) -> Stack:
    """Of a program with its map and the .ci files of its objects.  Raises StackError."""
    graph = _compiled(elf.with_suffix(".map"))
    symbols = {symbol.name: symbol.address for symbol in measure.symbols(elf)}
    _add_library(graph, elf)
    graph.calls[INDIRECT] = {name for name in graph.own if name.split(":")[-1] in _taken(elf, symbols)}
    graph.own[INDIRECT] = 0
    graph.calls.setdefault(FAULT, set()).add(FAULT_BODY)
    handlers = [name for name in graph.own if re.fullmatch(r"\w+_Handler", name) and name not in (RESET, FAULT)]
    main, deepest = _depth(graph, RESET)
    return Stack(
        main=main,
        interrupt=EXCEPTION_BYTES + max(_depth(graph, name)[0] for name in handlers),
        fault=EXCEPTION_BYTES + _depth(graph, FAULT)[0],
        reserved=symbols["stack_bytes"],
        deepest=deepest,
    )


def sections(elf: Path) -> dict[str, int]:
    """Bytes of code and constants, of variables, and of the stack."""
    sizes = {name: int(size) for name, size in re.findall(r"^(\.\w+)\s+(\d+)", _tool("size", "-A", elf), re.M)}
    variables = sum(sizes.get(name, 0) for name in (".data", ".bss", ".kept"))
    return {"code": sizes[".text"] + sizes.get(".data", 0), "variables": variables, "stack": sizes[".stack"]}


def _compiled(map_file: Path) -> Graph:
    graph = Graph()
    for linked_object in re.findall(r"^LOAD (.+)\.o$", map_file.read_text(encoding="utf-8"), re.M):
        path = measure.HERE / f"{linked_object}.ci"
        text = path.read_text(encoding="utf-8")
        for name, size, kind in re.findall(r'^node: \{ title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \(([^)]+)\)"', text, re.M):
            if kind == "dynamic":
                raise StackError(f"{path.stem}: the frame of {name} has no bound")
            graph.own[name] = int(size)
        for caller, called in re.findall(r'^edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text, re.M):
            graph.calls.setdefault(caller, set()).add(called)
    return graph


def _tool(name: str, *words: str | Path) -> str:
    return subprocess.run([PREFIX + name, *words], capture_output=True, text=True, check=True).stdout


def _taken(elf: Path, symbols: dict[str, int]) -> set[str]:
    """Functions whose address is in the program's memory, apart from its vectors."""
    with tempfile.TemporaryDirectory(prefix="tinygc-") as folder:
        image = Path(folder) / "image.bin"
        _tool("objcopy", "-O", "binary", elf, image)
        data = image.read_bytes()
    words = set(struct.unpack_from(f"<{len(data) // 4 - VECTORS}I", data, 4 * VECTORS))
    return {name for name, address in symbols.items() if address | 1 in words and address >= 0x08000000 + 4 * VECTORS}


def _add_library(graph: Graph, elf: Path) -> None:
    """Functions that are called and not compiled here: what they push, and what they call."""
    bodies = dict(re.findall(r"^\w+ <(\S+)>:\n((?:.+\n)+)", _tool("objdump", "-d", "--no-show-raw-insn", elf), re.M))
    waiting = {name for called in graph.calls.values() for name in called if name not in graph.own} - {INDIRECT}
    while waiting:
        name = waiting.pop()
        if name not in bodies:  # of a function that the linker has dropped
            graph.own[name] = 0
            continue
        graph.own[name] = _pushed(bodies[name])
        called = {target for target in re.findall(r"\tbl?(?:\.w|\.n)?\t\w+ <([^>+]+)>", bodies[name]) if target != name}
        graph.calls[name] = called
        waiting |= called - graph.own.keys()


def _pushed(body: str) -> int:
    """Bytes that a function's instructions take from the stack, branches not regarded."""
    lists = re.findall(r"\t(?:push|stmdb|stmfd)(?:\.w)?\t(?:sp!, )?\{([^}]*)\}", body)
    count = 4 * sum(_registers(words) for words in lists)
    count += sum(_registers(words) * (8 if words.startswith("d") else 4) for words in re.findall(r"\tvpush\t\{([^}]*)\}", body))
    count += sum(int(number) for number in re.findall(r"\tsub(?:w|\.w)?\tsp, (?:sp, )?#(\d+)", body))
    return count + sum(int(number) for number in re.findall(r"\[sp, #-(\d+)\]!", body))


def _registers(words: str) -> int:
    spans = [re.findall(r"\d+", part) for part in words.split(",") if "-" in part]
    return words.count(",") + 1 + sum(int(last) - int(first) for first, last in spans)


def _depth(graph: Graph, start: str) -> tuple[int, tuple[str, ...]]:
    """Bytes of the deepest path from a function, and the path."""
    known: dict[str, tuple[int, tuple[str, ...]]] = {}

    def deepest(name: str, above: tuple[str, ...]) -> tuple[int, tuple[str, ...]]:
        if name in above:
            raise StackError(f"recursion: {' calls '.join((*above[above.index(name) :], name))}")
        if name not in known:
            below = [deepest(called, (*above, name)) for called in sorted(graph.calls.get(name, ()))]
            size, path = max(below, default=(0, ()))
            known[name] = graph.own.get(name, 0) + size, (name, *path)
        return known[name]

    return deepest(start, ())
