"""No text makes a pattern of the product take more than a time in proportion to its length."""

import ast
import builtins
import importlib
import re
import sys
import time
from itertools import product
from pathlib import Path
from re import _constants as code
from re import _parser
from typing import NamedTuple

import pytest

from session.bench.events import StreamFormat
from session.bench.text_stream import _DECIMAL, _WHOLE, _run

ROOT = Path(__file__).resolve().parent.parent
METHODS = {"compile", "search", "match", "fullmatch", "split", "findall", "finditer", "sub", "subn"}
#: of a text; a pattern that is fast enough at FEW of them is so at the most, were it quadratic
FEW, FAST_S = 3000, 0.0007
#: up to 30 000 characters: each twice the one before, but at first, where time may be a power of the length
LENGTHS = (*range(8, 40, 2), *(30_000 >> power for power in range(9, -1, -1)))
#: what can be told from the clock's own steps; between the 2 of linear time and the 4 of quadratic
TOLD_S, WORSE = 0.004, 3.0
#: times that it must be seen
SURE = 4
#: of this thread alone, where it is counted finely: the machine may be busy
clock = time.perf_counter if sys.platform == "win32" else time.thread_time

CATEGORIES = {code.CATEGORY_DIGIT: r"\d", code.CATEGORY_SPACE: r"\s", code.CATEGORY_WORD: r"\w"}
CATEGORIES |= {code.CATEGORY_NOT_DIGIT: r"\D", code.CATEGORY_NOT_SPACE: r"\S", code.CATEGORY_NOT_WORD: r"\W"}
REPEATS = (code.MAX_REPEAT, code.MIN_REPEAT, code.POSSESSIVE_REPEAT)
CHARACTERS = [chr(at) for at in (0, 9, 10, 13, *range(32, 127), 0xB0, 0xB5, 0x3C4, 0xDC80)]
BAD = "\0"


class Used(NamedTuple):
    """A pattern, and whether it begins at one place of a text, or is tried at each."""

    pattern: re.Pattern
    anchored: bool


class _Names(dict):
    """A module's names, and a stand-in for each that only a function's call gives a value."""

    def __missing__(self, name):
        if hasattr(builtins, name):
            raise KeyError(name)
        return "x"


def patterns():
    """{file and line: pattern} of every call of ``re``'s functions, and of what a module makes of its tables while it is imported."""
    trees = {}
    for path in [ROOT / "calibrate.py", *sorted((ROOT / "session").rglob("*.py")), *sorted((ROOT / "tinygc").rglob("*.py"))]:
        text = path.read_text(encoding="utf-8")
        if re.search(r"\bre\.|\.(?:search|match|fullmatch|finditer|subn?)\(", text):
            trees[path] = ast.parse(text)
    calls, methods, names = [], {}, {}
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                names[id(node.value)] = node.targets[0].id
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in METHODS):
                continue
            if isinstance(node.func.value, ast.Name) and node.func.value.id == "re":
                calls.append((path, node))
            else:
                name = getattr(node.func.value, "id", getattr(node.func.value, "attr", ""))
                for key in ((path, name), name):
                    methods.setdefault(key, set()).add(node.func.attr)
    found = {}
    for path, node in calls:
        parts = path.relative_to(ROOT).with_suffix("").parts
        plain = isinstance(node.args[0], ast.Constant)  # most are, and to import all modules takes seconds
        known = _Names({} if plain else vars(importlib.import_module(".".join(parts))), re=re)
        text = _value(node.args[0], known)
        others = [*node.args[1:], *(word.value for word in node.keywords)]
        flags = [_value(each, known) for each in others if re.fullmatch(r"re\.[A-Z]+(?: \| re\.[A-Z]+)*", ast.unparse(each))]
        name = names.get(id(node), "")
        used = {node.func.attr} if node.func.attr != "compile" else methods.get((path, name)) or methods.get(name) or {"search"}
        where = f"{'/'.join(parts)}.py:{node.lineno}"
        found[where] = Used(text if isinstance(text, re.Pattern) else re.compile(text, *flags), used <= {"match", "fullmatch"})
        for number, pattern in enumerate([] if plain else _within([*known.values()])):
            found.setdefault(f"{where} {number}", Used(pattern, False))
    return found


def _value(node, known):
    return eval(compile(ast.Expression(node), "", "eval"), {}, known)


def _within(values):
    """Patterns that stand in lists, tuples and dictionaries."""
    inner = [each for value in values if isinstance(value, list | tuple) for each in value]
    inner += [each for value in values if type(value) is dict for each in value.values()]
    return [each for each in inner if isinstance(each, re.Pattern)] + (_within(inner) if inner else [])


class _Parts:
    """Of a pattern: a text that it takes, what stands before each of its repeats, and a character of each kind that it tells apart."""

    def __init__(self, pattern):
        self._ignore_case, self._binary = bool(pattern.flags & re.IGNORECASE), isinstance(pattern.pattern, bytes)
        self._atoms: list[list] = []
        self.beginnings = {"": None}
        self.whole = self._text(_parser.parse(pattern.pattern, pattern.flags & ~re.UNICODE if self._binary else pattern.flags))
        kinds = {tuple(self._has(atom, each) for atom in self._atoms): each for each in CHARACTERS if not self._binary or ord(each) < 128}
        self.characters = list(kinds.values())

    def _has(self, atom, character):
        forms = {character, character.lower(), character.upper()} if self._ignore_case else {character}
        inside = any(
            (kind is code.LITERAL and chr(value) in forms)
            or (kind is code.RANGE and any(value[0] <= ord(form[0]) <= value[1] for form in forms))
            or (kind is code.CATEGORY and re.match(CATEGORIES[value], character) is not None)
            for kind, value in atom
        )
        return inside != (atom[0][0] is code.NEGATE)

    def _text(self, tree, before=""):
        made = ""
        for kind, value in tree:
            if kind in (code.LITERAL, code.NOT_LITERAL, code.IN, code.ANY):
                atom = value if kind is code.IN else [(code.LITERAL, 10 if kind is code.ANY else value)]
                atom = atom if kind in (code.IN, code.LITERAL) else [(code.NEGATE, None), *atom]
                self._atoms.append(atom)
                made += chr(value) if kind is code.LITERAL else next((each for each in CHARACTERS[:3:-1] if self._has(atom, each)), "")
            elif kind in REPEATS:
                self.beginnings[before + made] = None
                made += self._text(value[2], before + made) * max(value[0], 1)
            elif kind in (code.SUBPATTERN, code.ATOMIC_GROUP):
                made += self._text(value[3] if kind is code.SUBPATTERN else value, before + made)
            elif kind is code.BRANCH:
                first, *_ = [self._text(each, before + made) for each in value[1]]
                made += first
            elif kind in (code.ASSERT, code.ASSERT_NOT):
                self._text(value[1], before + made)
        return made

    def texts(self):
        """(beginning, what is repeated, end)."""
        for beginning, repeated in product(self.beginnings, filter(None, [*self.characters, self.whole])):
            yield from ((beginning, repeated, end) for end in ("", BAD))
        yield from (("", one + other, BAD) for one, other in product(self.characters, repeat=2) if one != other)


def _seconds(used, text, tries=1):
    taken = []
    data = text.encode("latin-1", "replace") if isinstance(used.pattern.pattern, bytes) else text
    for _ in range(tries):
        begun = clock()
        if used.anchored:
            used.pattern.match(data)
            used.pattern.fullmatch(data)
        else:
            used.pattern.sub(used.pattern.pattern[:0], data)
        taken.append(clock() - begun)
    return min(taken)


def worse_than_linear(used):
    """A text that takes three times as long for twice its length; None where there is none."""
    for beginning, repeated, end in _Parts(used.pattern).texts():
        before = 0.0
        for length in LENGTHS:
            text = beginning + repeated * (length // len(repeated)) + end
            taken = _seconds(used, text)
            if taken > max(TOLD_S, WORSE * before):
                shorter = beginning + repeated * (length // 2 // len(repeated)) + end
                for _ in range(SURE if taken < 1 else 1):  # beside other work caches are not this thread's alone
                    taken, before = _seconds(used, text, 1 if taken > 1 else 5), _seconds(used, shorter, 5)
                    if taken <= max(TOLD_S, WORSE * before):
                        break
                else:
                    return f"{beginning!r} {repeated!r}... {end!r}: {taken:.3f} s for {length} characters, {before:.3f} s for half of it"
            if length > FEW and taken < FAST_S:
                break
            before = taken
    return None


@pytest.mark.parametrize("pattern", [r"(?:a|a)*b", r"\s*=", r"(?:[ ]*- .*\n?)+$"])
def test_a_pattern_that_explodes_is_found_out(pattern):
    assert worse_than_linear(Used(re.compile(pattern), False)) is not None


@pytest.mark.parametrize("pattern", [r"(?<!a)a++b", r"(?<!\d)\d++,(?<!\d)\d++x", r"(?<!\s)\s*+=", r"\b(\w++)="])
def test_a_pattern_in_proportion_is_not(pattern):
    assert worse_than_linear(Used(re.compile(pattern), False)) is None


@pytest.mark.slow
def test_every_pattern_takes_a_time_in_proportion_to_the_text():
    found = patterns()
    assert len(found) > 50
    for names in (StreamFormat().names, ("t_s", "gx_dps", "gy_dps", "gz_dps", "ax_g", "ay_g", "az_g")):  # one is made of the header
        found[f"runs of {names[0]}"] = Used(re.compile(_run(len(names), StreamFormat(names)).pattern.decode()), True)
    found |= {"a number of a stream": Used(re.compile(_DECIMAL.decode()), True), "a whole one": Used(re.compile(_WHOLE.decode()), True)}
    slow = {where: text for where, used in found.items() if (text := worse_than_linear(used)) is not None}
    assert not slow


@pytest.mark.parametrize("line", [f"acc: {'2' * 150},{'2' * 150},{'2' * 150}x", "acc" + " " * 16_000])
def test_a_log_with_a_long_torn_line_is_imported_at_once(run, tmp_path, line):
    log = tmp_path / "log.txt"
    log.write_text("acc: 1, 2, 3, gyro: 4, 5, 6\n" * 400 + line + "\n")
    code, _, err = run("import", log, "--odr", "100", "--gyro-unit", "dps", "--accel-unit", "g", "--out", tmp_path / "s")
    assert code in (0, 2), err
