"""Run the commands that the pages show, and write what they print into the pages: ``python docs/make_outputs.py [PAGE …]``.

``python docs/make_outputs.py --measured PAGE [TEXT]`` runs the page's benchmarks whose command has this text: a paragraph that begins with
```python benchmarks/NAME.py …` (DATE)`` stands above tables of what this command prints, and gets the date of the run.

A block whose first line begins with ``$`` is run, line by line, in a scratch folder of its page, which holds a copy of ``data``; the output
replaces what stands below each line.  Comments above the block change that:

- ``<!-- run: COMMAND -->``: a command that is not shown; the file ``PAGE`` is the page;
- ``<!-- lines 1-4, 9-12 -->``: these lines of each output, with … where lines are left out;
- ``<!-- run -->`` above a block of Python: it is run, and must not fail;
- ``<!-- not run: REASON -->``: the block stays as it is.

A page with ``<!-- slow examples -->`` takes more than some seconds, one with ``<!-- nightly examples -->`` more than twenty.
tests/test_page_outputs.py holds the pages to what is printed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: a comment, or a block with its language
PART = re.compile(r"^<!-- (.*?) -->$|^( *)```(\w*)\n(.*?)^ *```$", re.S | re.M)
SLOW, NIGHTLY = "<!-- slow examples -->", "<!-- nightly examples -->"
#: a benchmark's command, its date, the rest of the paragraph, and the tables below it
MEASURED = re.compile(r"^`python (benchmarks/[^`]*)` \((\d+ \w+ \d{4})\)(.*\n\n)((?:\|.*\n)+(?:\n(?:\|.*\n)+)*)", re.M)
TABLE = re.compile(r"^(\|.*\n)(?:\|.*\n)+", re.M)
#: runs the checkout's command line under the name that a reader types
SCRIPT = """import sys
sys.path.insert(0, {root!r})
if __name__ == "__main__":
    sys.argv[0] = "calibrate.py"
    import calibrate
    sys.exit(calibrate.main())
"""


def pages() -> list[Path]:
    """Pages with something to run."""
    every = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "data").glob("*.md")]
    return sorted(path for path in every if re.search(r"^ *```\n *\$ |^<!-- run", path.read_text(encoding="utf-8"), re.M))


def made(text: str) -> str:
    """The text of a page with the outputs of its commands."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent)
        shutil.copytree(ROOT / "data", folder / "data", ignore=shutil.ignore_patterns("fit", "explain", "*.html"))
        (folder / "calibrate.py").write_text(SCRIPT.format(root=str(ROOT)), encoding="utf-8")
        (folder / ".bin").mkdir()
        (folder / ".bin" / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n', encoding="utf-8")
        (folder / ".bin" / "python").chmod(0o755)
        (folder / "PAGE").write_text(text, encoding="utf-8")
        notes: list[str] = []

        def part(found: re.Match[str]) -> str:
            comment, indent, language, body = found.groups()
            if comment is not None:
                command = comment.removeprefix("run: ")
                if command != comment:
                    _output(command, folder)
                notes.append(comment)
                return found[0]
            asked, notes[:] = list(notes), []
            if any(note.startswith("not run") for note in asked):
                return found[0]
            if language == "python" and "run" in asked:
                _output(f"python - <<'END'\n{body}END", folder)
            if language or not body.lstrip().startswith("$ "):
                return found[0]
            ranges = next((note for note in asked if note.startswith("lines ")), "lines 1-9999")
            lines = [line.strip() for line in body.splitlines() if line.strip().startswith("$ ")]
            shown = [each for line in lines for each in (line, *_chosen(_output(line[2:], folder), ranges))]
            return "\n".join([f"{indent}```", *(f"{indent}{line}".rstrip() for line in shown), f"{indent}```"])

        return PART.sub(part, text)


def measured(text: str, part: str = "") -> str:
    """The text of a page, its benchmarks with this text in their command run: their tables by their heads, and today's date."""

    def block(found: re.Match[str]) -> str:
        command, _, rest, tables = found.groups()
        if part not in command:
            return found[0]
        printed = "\n".join([*_output(f"{sys.executable} {command}", ROOT, None), ""])
        if missing := [table[1] for table in TABLE.finditer(tables) if table[1] not in printed]:
            raise RuntimeError(f"{command} prints no table with the head {missing[0]}{printed}")
        by_head = {table[1]: table[0] for table in TABLE.finditer(printed)}
        today = datetime.now(tz=UTC).strftime("%d %B %Y").lstrip("0")
        return f"`python {command}` ({today}){rest}" + TABLE.sub(lambda table: by_head[table[1]], tables)

    return MEASURED.sub(block, text)


def _output(command: str, folder: Path, timeout_s: float | None = 600) -> list[str]:
    """What a command prints; of one that refuses, the line that it refuses with."""
    environment = {
        **os.environ,
        "PATH": f"{folder / '.bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "PYTHONIOENCODING": "utf-8",
        "TINYGC_DEFAULTS": "",
        "COLUMNS": "80",
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    done = subprocess.run(
        ["bash", "-c", command],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=timeout_s,
        check=False,
    )
    printed = done.stdout.replace(f"{folder}{os.sep}", "")
    if done.returncode not in (0, 1, 5):
        if "Traceback" in done.stderr:
            raise RuntimeError(f"{command}: exit code {done.returncode}\n{done.stderr}")
        printed += done.stderr
    return [line.rstrip() for line in printed.splitlines()]


def _chosen(lines: list[str], ranges: str) -> list[str]:
    shown: list[str] = []
    end = 0
    for first, last in re.findall(r"(\d+)-(\d+)", ranges):
        if int(first) > len(lines):
            break
        if int(first) - 1 > end:
            shown.append("…")
        end = int(last)
        shown += lines[int(first) - 1 : end]
    return [*shown, "…"] if end < len(lines) else shown


def main() -> None:
    """Bring the named pages, or all, up to date."""
    if sys.argv[1:2] == ["--measured"]:
        path, part = Path(sys.argv[2]), " ".join(sys.argv[3:])
        path.write_text(measured(path.read_text(encoding="utf-8"), part), encoding="utf-8")
        return
    for path in [Path(name).resolve() for name in sys.argv[1:]] or pages():
        old = path.read_text(encoding="utf-8")
        new = made(old)
        if new != old:
            path.write_text(new, encoding="utf-8")
        print(f"{path.relative_to(ROOT)}: {'written' if new != old else 'unchanged'}")


if __name__ == "__main__":
    main()
