"""Texts that want to be more than text, put into every field of a session: what becomes of them in each format.

Serial number, model, session, method, names of files, notes: each is set to each hostile text.  What is written is read back as the
program that it is for would read it, and held against what a harmless text gives: a line, a key, a statement or an element more is
injected.
"""

from __future__ import annotations

import ast
import json
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from html.parser import HTMLParser
from io import StringIO
from xml.etree import ElementTree

import numpy as np
import yaml
from feature import feature
from rich.table import Table
from rich.text import Text

from session.base.console import PlainConsole
from session.base.errors import CalibrationError
from session.base.texts import comment, printable, unicode_text
from session.bench.session_file import toml_text
from session.detect.findings import Finding
from session.log.config import Accelerometer, Config, LeftOut, Protocol, Sensor, Site
from tinygc.deploy.exports import exporter
from tinygc.deploy.exports._context import Context
from tinygc.models.linear import LinearModel
from tinygc.noise.figures import TERMS, AxisNoise, Inflation, NoiseFigures, SensorNoise, Term
from tinygc.reporting.html.markup import code, escape, table

dcc_file = feature("tinygc.features.unit.certificate.dcc_file")
HARMLESS = "unit 7"
UNREADABLE = 1000
PAYLOADS = {  # a line of each format that does something
    "px4": "1\t1\tCBRK_SUPPLY_CHK\t894281\t6",
    "ardupilot": "ARMING_CHECK,0",
    "yaml": "update_rate: 1.0",
    "yaml in a table": "  evil: [1, 2]",
    "c": "__attribute__((constructor)) static void evil(void) { system(0); }",
    "toml": '[sensor]\nmodel = "evil"',
    "json": '", "evil": "',
}
#: everything that some reader takes for the end of a line
LINE_ENDS = ("\n", "\r", "\r\n", "\v", "\f", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029")
HOSTILE = (
    *(f"a\n{payload}\nb" for payload in PAYLOADS.values()),
    *(f"a{end}{PAYLOADS['ardupilot']}{end}b" for end in LINE_ENDS),
    *(f"{sign * 30} INS_GYROFFS_X 5" for sign in "éç😀"),
    "a */ int evil; /*",
    "a */\nint evil;",
    "a *\x00/ int evil; /\x00*",
    "-->  <script>alert(1)</script> <!--",
    "</title></style></script><script>alert(1)</script>",
    '" onmouseover="alert(1)" \'',
    "]]><b>",
    "a \\",
    "a ??/",
    "a ????//",
    "a \\ \t",
    "\x1b[2J\x1b[31mred\x1b]0;title\x07\x1b]8;;http://evil\x1b\\link",
    "\x9b31mred \x90sixel\x9c",
    "\x08\x08\x08erased\x7f",
    "\x00nul",
    "[red]rich[/red] [/bold] [link=http://evil]x[/link] :skull:",
    "\u202egnirts\u202c \u2066isolated\u2069 \u200b\u200e\ufeff",
    "caf\udce9 \udcff\udc80",
    "\ud800 alone \udfff",
    "😀 Ø-12 µ 你好 ñ",
    "# gyro_fs_dps=1 stamps=counted calibrated=gyro",
    "'; DROP TABLE; $(reboot) `reboot` && ${HOME}",
    "{braces} %s %n {0.__class__}",
    "---\n- a\n...\n%YAML 1.1",
    "&anchor *alias !!python/object/apply:os.system [reboot]",
    '"""\n[sensor]\n"""',
    "'''\n[sensor]\n'''",
    "x" * 5000,
    " ",
    "",
)
#: whatever lies at the 98th byte of a line is a parameter for ArduPilot
LONG = tuple(f"{'a' * size} INS_GYROFFS_X 5" for size in range(20, 120))


@dataclass(frozen=True)
class Place:
    """A way out of the tool.  write(text) -> what is written; read(written) -> what its reader makes of it, the same for every text
    but for its values; kept(text, written): whether the values that it promises to hold are there."""

    write: Callable[[str], str]
    read: Callable[[str], list[str]]
    kept: Callable[[str, str], bool] = lambda text, written: True


def injected(place, text):
    """Lines, keys, statements or elements that a harmless text does not make; UNREADABLE where it cannot be read, or not the same."""
    try:
        written = place.write(text)
        written.encode("utf-8")
        found, expected = place.read(written), harmless(place)
        if not place.kept(text, written):
            return UNREADABLE
    except Exception:
        return UNREADABLE
    return abs(len(found) - len(expected)) or sum(a != b for a, b in zip(found, expected, strict=True))


@cache
def harmless(place):
    """What is made of a text that wants nothing."""
    return place.read(place.write(HARMLESS))


# Readers


def lines_but_comments(text):
    """As a reader of lines that knows every line end there is; a mark of a comment counts only at the beginning of a line."""
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def ardupilot(text):
    """As ArduPilot reads a file of its own: ``fgets`` of 98 bytes, and a line that begins with # is left out."""
    found = []
    for line in re.split(rb"(?<=\n)", text.encode()):
        found += [part for part in re.findall(rb"(?s).{1,98}", line) if not part.startswith(b"#")]
    return [part.decode(errors="replace") for part in found] + lines_but_comments(text)


def yaml_table(text):
    """By PyYAML, and by lines."""
    return [json.dumps(yaml.safe_load(text)), *(line.split("  #")[0] for line in lines_but_comments(text))]


def c_statements(text):
    """As a compiler's first phases leave it: trigraphs, joined lines, then comments as a blank."""
    text = text.replace("??/", "\\")
    text = re.sub(r"\\[ \t\v\f]*\r?\n", "", text)
    text = re.sub(r'"(?:[^"\\\n]|\\.)*"|//[^\n]*|/\*.*?\*/', lambda found: found[0] if found[0].startswith('"') else " ", text, flags=re.S)
    return [line.strip() for line in text.splitlines() if line.strip()]


def python_code(text):
    """By Python's own parser, and by lines."""
    return [ast.dump(ast.parse(text)), *lines_but_comments(text)]


def terminal(text):
    """Lines, and control characters that reach the terminal, each as one more."""
    return ["line" for _ in text.splitlines()] + ["control" for c in text if c != "\n" and not c.isprintable()]


class _Elements(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.found.append(f"{tag} {sorted(name for name, _ in attributes)}")

    def handle_comment(self, data):
        self.found.append("comment")

    def handle_decl(self, declaration):
        self.found.append("declaration")

    unknown_decl = handle_pi = handle_decl


def elements(html):
    """Elements with the names of their attributes, comments and declarations."""
    parser = _Elements()
    parser.feed(html)
    parser.close()
    return parser.found + ["control" for c in html if c != "\n" and not c.isprintable()]


# Writers

LINEAR = LinearModel(np.eye(3) + 0.01 * np.arange(9).reshape(3, 3), np.array([0.01, -0.02, 0.03]))
NOISE = {"gyro_dps_rthz": [5e-3, 6e-3, 4e-3], "accel_g_rthz": [6e-5] * 3, "gyro_bias_instability_dph": 3.0}


def config(text):
    """A configuration whose texts are all this one."""
    sensor = Sensor(text, text, 208.0, 500.0, 4.0)
    notes = {text: text, f"{text}2": text}
    return Config(sensor, Accelerometer(), Site(31.03, 9.8), Protocol(), notes=notes, exclude=(LeftOut(text, 3.0),))


def context(text):
    """What an exporter is told, with this text wherever a person, a file or a board may put one."""
    table = {"session": text, "method": text, "covariance": np.eye(12).tolist()}
    fit = {"noise": NOISE | {"gyro_bias_instability_source": text}, "accelerometer": {"unobserved": [text]}}
    known = replace(config(text), sensor=replace(config(text).sensor, model=f"ASM330LHH {text}"))
    silent = dict.fromkeys(TERMS, Term(0.0, None, 0.0))
    axis = AxisNoise(silent | {"N": Term(1e-4, 1e-6, 1.0), "K": Term(1e-6, 1e-7, 1.0)})
    sensor = SensorNoise((axis, axis, axis))
    motion = Inflation(text, np.ones(3), np.ones(3), {text: np.ones(3)}, text)
    noise = NoiseFigures(
        gyro=sensor,
        accel=sensor,
        rate_hz=208.0,
        duration_s=3600.0,
        samples=748_800,
        logs=(text,),
        sensor=text,
        serial=text,
        inflations=(motion,),
    )
    return Context(text, text, known, table, fit, {text: "0" * 64, f"{text}.csv": "1" * 64}, noise=noise)


def file_of(format_name, ending=""):
    """The exported file with that ending."""

    def write(text):
        files = exporter(format_name).export(LINEAR, context(text))
        assert all(re.fullmatch(r"[A-Za-z0-9_.-]{1,120}", name) for name in files), files
        return next(content for name, content in files.items() if name.endswith(ending))

    return write


def printed(text):
    """All that a page for people may hold: strings, cells, titles, errors, findings."""
    console = PlainConsole(file=StringIO(), width=20_000, force_terminal=False)
    cells = Table(title=f"of {text}", caption=f"of {text}")
    cells.add_column(f"of {text}")
    cells.add_row(f"of {text}")
    finding = Finding("error", text, "units", text, text)
    for page in (f"of {text}", cells, Text(printable(f"of {text}")), str(CalibrationError(text)), finding.line):
        console.print(page, soft_wrap=True)
    return console.file.getvalue()  # type: ignore[attr-defined]


def fragment(text):
    """The pieces that the report is made of."""
    cell = escape(text)
    return f'<title>{cell}</title><p title="{cell}">{cell}</p>' + table((cell, cell), [(cell, cell)]) + code(f"a\n{text}")


def toml_values(text, written):
    """Whether every value came back as it was, but for bytes that no TOML can hold."""
    found, plain = tomllib.loads(written), unicode_text(text)
    values = [found["sensor"]["model"], found["sensor"]["serial"], found["notes"][plain], found["exclude"][0]["log"]]
    return values == [plain] * 4


def toml_lines(written):
    """Names of its tables, how many entries each has, and its lines."""
    return [*(f"{name} {len(entry)}" for name, entry in tomllib.loads(written).items()), *("line" for _ in written.splitlines())]


def certified(text):
    """The text as a name in a Digital Calibration Certificate."""
    root = ElementTree.Element("item", {"schemaVersion": "3.3.0"})
    dcc_file.named(root, "name", text)
    return ElementTree.tostring(root, encoding="unicode")


def xml_elements(written):
    """Elements and attributes; ParseError, which counts as unreadable, for what is not well formed."""
    return [part for each in ElementTree.fromstring(written).iter() for part in (each.tag, *each.attrib)]


PLACES = {
    "px4": Place(file_of("px4"), lines_but_comments),
    "ardupilot": Place(file_of("ardupilot"), ardupilot),
    "ardupilot noise": Place(file_of("ardupilot", "noise.param"), ardupilot),
    "kalibr imu.yaml": Place(file_of("kalibr", "imu.yaml"), yaml_table),
    "gtsam Python": Place(file_of("gtsam", ".py"), python_code),
    "xio header": Place(file_of("xio", ".h"), c_statements),
    "xio JSON": Place(file_of("xio", ".json"), lambda written: [*json.loads(written), *("line" for _ in written.splitlines())]),
    "c header": Place(file_of("c", ".h"), c_statements),
    "c source": Place(file_of("c", ".c"), c_statements),
    "session.toml": Place(lambda text: toml_text(config(text)), toml_lines, toml_values),
    "comment of a log": Place(lambda text: f"# from {comment(text)}\nt_us,gx\n", lines_but_comments),
    "terminal": Place(printed, terminal),
    "HTML": Place(fragment, elements),
}
if dcc_file is not None:
    PLACES["XML"] = Place(certified, xml_elements)
