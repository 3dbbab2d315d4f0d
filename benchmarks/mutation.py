"""Mutation testing: do the quick tests of a subject notice a fault in one operator, one number, one comparison?

    python benchmarks/mutation.py                       every subject, 150 mutants of each
    python benchmarks/mutation.py priors verdicts       some
    python benchmarks/mutation.py --all priors          every mutant of a subject
    python benchmarks/mutation.py --week                every mutant of this week's subject
    python benchmarks/mutation.py --fixed               the short list that CI runs; exit code 1 if one survives

Mutants are made by Cosmic Ray (``.[mutation]``).  A mutant is known by its file, function, operator, line of source and place in the
line, so that an edit elsewhere neither renames it nor moves it into the sample or out of it: the sample are the mutants whose names have
the smallest hashes.  Left out are mutants of annotations, of ``raise`` and of formatted texts.

Each mutant is a forked process with NumPy, SciPy and PyTorch already loaded; the changed source is compiled where Python imports it, and
no file is touched, so checkouts and other runs are undisturbed.  Tests that start a process of their own see the unchanged source.
Tests that cover the changed statement run first, the fastest before the others, then the other tests of their files (a fixture is made
once); where none does, it survives at once.

``benchmarks/mutation/SUBJECT.toml`` names a subject's files and quick tests, as pytest takes them (``--deselect=`` of slow ones);
``functions``: only these of the files; ``texts = true``: also inside formatted texts, where C code is the product.  Its table
``equivalent`` lists the mutants that change nothing anybody could observe, each with its reason; these do not count.  Its table ``fixed``
is its part of CI's list: mutant = a test that kills it.
"""

from __future__ import annotations

import argparse
import ast
import datetime
import gc
import hashlib
import importlib
import importlib.machinery
import json
import os
import resource
import signal
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

sys.path[0] = str(Path(__file__).resolve().parent.parent)  # and not this folder, which has a coverage.py of its own
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

ROOT = Path(__file__).resolve().parent.parent
LISTS = ROOT / "benchmarks" / "mutation"
SAMPLE = 150
#: Only these: a mutant that ends in a TypeError, as a shift of floats does, says nothing of a test.
BINARY = """Add_Sub Add_Mul Sub_Add Sub_Div Mul_Div Mul_Add Div_Mul Div_Sub FloorDiv_Div FloorDiv_Mul Mod_FloorDiv Pow_Mul Pow_Div
BitAnd_BitOr BitOr_BitAnd BitXor_BitAnd RShift_LShift LShift_RShift"""
COMPARISON = "Eq_NotEq NotEq_Eq Lt_LtE Lt_Gt LtE_Lt LtE_Gt Gt_GtE Gt_Lt GtE_Gt GtE_Lt Is_IsNot IsNot_Is"
OTHERS = """ReplaceUnaryOperator_Delete_USub ReplaceUnaryOperator_Delete_Invert ReplaceUnaryOperator_Delete_Not AddNot ReplaceTrueWithFalse
ReplaceFalseWithTrue ReplaceAndWithOr ReplaceOrWithAnd ReplaceBreakWithContinue ReplaceContinueWithBreak NumberReplacer
ZeroIterationForLoop"""
OPERATORS = [f"core/ReplaceBinaryOperator_{name}" for name in BINARY.split()]
OPERATORS += [f"core/ReplaceComparisonOperator_{name}" for name in COMPARISON.split()]
OPERATORS += [f"core/{name}" for name in OTHERS.split()]
#: Loaded before the first fork, so that no mutant waits for them.
PRELOADED = """numpy scipy.linalg scipy.optimize scipy.special scipy.signal scipy.stats scipy.interpolate scipy.sparse scipy.ndimage
scipy.spatial.transform scipy.integrate torch pytest _pytest.assertion.rewrite hypothesis xdist rich.console rich.table jinja2 yaml
tomlkit serial"""
QUICK = "not slow and not broad and not wheel and not browser and not emulation"


@dataclass(frozen=True)
class Subject:
    """A room of the code, and the quick tests that must notice its faults.  ``texts``: formatted texts are its product (C code)."""

    name: str
    files: tuple[str, ...]
    tests: tuple[str, ...]
    functions: tuple[str, ...] = ()
    texts: bool = False
    equivalent: dict[str, str] = field(default_factory=dict)  # name of a mutant: why nobody could observe it
    fixed: dict[str, str] = field(default_factory=dict)  # name of a mutant on CI's list: a test that kills it


@dataclass(frozen=True)
class Mutant:
    file: str
    operator: str
    occurrence: int  # of the operator in the file: as Cosmic Ray counts
    line: int
    name: str  # stays when other lines change


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("subjects", nargs="*")
    parser.add_argument("--sample", type=int, default=SAMPLE, help="mutants of each subject (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (%(default)s)")
    parser.add_argument("--all", action="store_true", help="every mutant instead of a sample")
    parser.add_argument("--week", action="store_true", help="every mutant of one subject, another each week")
    parser.add_argument("--fixed", action="store_true", help="the tables `fixed` of all subjects; what CI runs")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="mutants at the same time (%(default)s)")
    args = parser.parse_args()
    subjects = read_subjects()
    if args.fixed:
        return run_fixed(subjects, args.jobs)
    if args.week:
        args.subjects, args.all = [list(subjects)[datetime.date.today().isocalendar().week % len(subjects)]], True
    unknown = set(args.subjects) - set(subjects)
    if unknown:
        parser.error(f"no subject {', '.join(sorted(unknown))}; there are {', '.join(subjects)}")
    results = [examine(subjects[name], args) for name in args.subjects or subjects]
    print("\n| subject | mutants in all | tried | equivalent | killed | survived | score | at least (95 %) | tests, CPU s | minutes |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for r in results:
        tried = r["killed"] + r["survivors"]
        score, limit = 100 * r["killed"] / max(tried, 1), 100 * lower_limit(r["killed"], tried)
        print(
            f"| {r['subject']} | {r['all']} | {tried + r['equivalent']} | {r['equivalent']} | {r['killed']} | {r['survivors']} "
            f"| {score:.1f} % | {limit:.1f} % | {r['test_s']:.1f} | {r['minutes']:.1f} |"
        )
    return 0


def lower_limit(killed: int, tried: int) -> float:
    """One-sided lower 95 % limit of the share killed (Clopper and Pearson 1934)."""
    from scipy.special import betaincinv  # not earlier: what loads NumPy's BLAS before the lines above gives each mutant its threads

    return float(betaincinv(killed, tried - killed + 1, 0.05)) if killed else 0.0


def read_subjects() -> dict[str, Subject]:
    subjects = {}
    for path in sorted(LISTS.glob("*.toml")):
        entry = tomllib.loads(path.read_text(encoding="utf-8"))
        subject = subjects[path.stem] = Subject(path.stem, **{k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()})
        for named in (*subject.files, *subject.tests, *subject.fixed.values()):
            if not (ROOT / named.removeprefix("--deselect=").partition("::")[0]).exists():
                sys.exit(f"{path.name}: {named} is not there")
    return subjects


def mutants_of(subject: Subject, named: Iterable[str] = ()) -> list[Mutant]:
    """All mutants of a subject's files, outside of annotations, ``raise`` and texts; named: in the files and by the operators of these."""
    import cosmic_ray.plugins
    from cosmic_ray.ast import ast_nodes, get_ast

    found: list[Mutant] = []
    wanted = {(name.partition("::")[0], name.split()[1]) for name in named}
    for file in subject.files:
        if wanted and file not in {each for each, _ in wanted}:
            continue
        source = (ROOT / file).read_text(encoding="utf-8")
        lines = source.splitlines()
        nodes = list(ast_nodes(get_ast(source)))
        seen: Counter = Counter()
        for name in OPERATORS:
            if wanted and (file, short(name)) not in wanted:
                continue
            operator = cosmic_ray.plugins.get_operator(name)()
            occurrence = -1
            for node in nodes:
                for (line, _), _ in operator.mutation_positions(node):
                    occurrence += 1
                    where = function_of(node)
                    if left_out(node, subject.texts) or (subject.functions and where.split(".")[0] not in subject.functions):
                        continue
                    key = f"{file}::{where} {short(name)} {lines[line - 1].strip()}"
                    seen[key] += 1
                    found.append(Mutant(file, name, occurrence, line, f"{key} #{seen[key]}"))
    return found


def short(operator: str) -> str:
    return operator.removeprefix("core/").removeprefix("Replace")


def function_of(node) -> str:
    names = []
    while node is not None:
        if node.type in ("funcdef", "classdef"):
            names.append(node.name.value)
        node = node.parent
    return ".".join(reversed(names)) or "module"


def left_out(node, texts: bool) -> bool:
    if node.type == "operator" and node.value in ("*", "**") and node.parent.type not in ("term", "power"):
        return True  # of arguments and of unpacking: what changes there is no program
    child = node
    while (parent := child.parent) is not None:
        if parent.type in ("raise_stmt", "assert_stmt", "import_from", "decorator"):
            return True
        # Of ``limit: float = 0.05``, only the annotation.
        if (parent.type == "annassign" and child is parent.children[1]) or (parent.type == "tfpdef" and child is parent.children[-1]):
            return True
        if parent.type == "funcdef" and child is parent.annotation:
            return True
        if parent.type in ("fstring_expr", "fstring_format_spec", "fstring") and not texts:
            return True
        child = parent
    return False


def examine(subject: Subject, args) -> dict:
    """Run a subject's tests on its sample; a record of what was killed and what survived."""
    started = time.monotonic()
    everyone = mutants_of(subject)
    known = subject.equivalent
    stale = set(known) - {mutant.name for mutant in everyone}
    for name in sorted(stale):
        print(f"{subject.name}: listed as equivalent, but there is no such mutant any more: {name}", file=sys.stderr)
    chosen = sorted(everyone, key=lambda mutant: hashlib.sha256(f"{args.seed} {mutant.name}".encode()).digest())
    if not args.all:
        chosen = chosen[: args.sample]
    tried = [mutant for mutant in chosen if mutant.name not in known]
    preload()
    timed = measure(subject)
    print(f"\n{subject.name}: {len(tried)} of {len(everyone)} mutants, tests of {timed['seconds']:.1f} s", flush=True)
    reached = [mutant for mutant in tried if covering(mutant, timed)]
    killed = dict(zip(reached, run_mutants([(mutant, subject.tests, timed) for mutant in reached], args.jobs), strict=True))
    outcomes = [killed.get(mutant, "survived") for mutant in tried]
    survivors = [mutant for mutant, outcome in zip(tried, outcomes, strict=True) if outcome == "survived"]
    for mutant in sorted(survivors, key=lambda m: (m.file, m.line)):
        print(f"  survived: line {mutant.line}: {mutant.name}", flush=True)
    return {
        "subject": subject.name, "all": len(everyone), "equivalent": len(chosen) - len(tried), "killed": len(tried) - len(survivors),
        "survivors": len(survivors), "test_s": timed["seconds"], "minutes": (time.monotonic() - started) / 60,
    }  # fmt: skip


def run_fixed(subjects: dict[str, Subject], jobs: int) -> int:
    """The short list: each mutant with the test that must kill it."""
    work, missing = [], []
    for subject in subjects.values():
        there = {mutant.name: mutant for mutant in mutants_of(subject, subject.fixed)} if subject.fixed else {}
        missing += [f"{subject.name}: {name}" for name in subject.fixed if name not in there]
        work += [(there[name], (test,), None) for name, test in subject.fixed.items() if name in there]
    preload()
    tests = tuple(sorted({test for _, (test,), _ in work}))
    sound = tests and run_mutants([(None, tests, None)], 1) == ["survived"]
    alone = [] if sound else run_mutants([(None, (test,), None) for test in tests], jobs)
    broken = [test for test, outcome in zip(tests, alone, strict=False) if outcome != "survived"]
    outcomes = run_mutants(work, jobs) if not broken else []
    alive = [mutant.name for (mutant, _, _), outcome in zip(work, outcomes, strict=False) if outcome == "survived"]
    for label, names in (("tests that fail without a fault", broken), ("no such mutant any more", missing), ("survived", alive)):
        for name in names:
            print(f"{label}: {name}")
    print(f"mutants: {len(outcomes) - len(alive)} passed, {len(alive) + len(missing) + len(broken)} failed")
    return 1 if alive or missing or broken else 0


def preload() -> None:
    for name in PRELOADED.split():
        importlib.import_module(name)
    gc.collect()
    gc.freeze()  # what is loaded stays: no child needs to look at it again


def measure(subject: Subject) -> dict:
    """Seconds of each test, the lines that it covers, and CPU seconds of all, without a fault; ends the program if a test fails."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        os.chdir(ROOT)
        import coverage

        cover = coverage.Coverage(data_file=None, include=[str(ROOT / file) for file in subject.files], config_file=False)
        watch = Watch(cover)
        cover.start()
        silence()
        code = run_pytest(subject.tests, [watch])
        cover.stop()
        lines: dict[str, dict[str, list[str]]] = {}
        data = cover.get_data()
        for file in subject.files:
            by_line = data.contexts_by_lineno(str(ROOT / file))
            lines[file] = {str(line): [c for c in contexts if c] if "" not in contexts else ["*"] for line, contexts in by_line.items()}
        with os.fdopen(writer, "w") as pipe:
            json.dump({"code": int(code), "tests": watch.seconds, "failed": watch.failed, "lines": lines}, pipe)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as pipe:
        text = pipe.read()
    os.waitpid(child, 0)
    result = json.loads(text) if text else {"code": -1, "failed": ["the tests ended their process"]}
    if result["code"]:
        sys.exit(f"{subject.name}: its tests fail without a fault: {' '.join(result['failed'])}")
    # Once more, as the mutants run: coverage makes some tests several times slower.
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    if run_mutants([(None, subject.tests, None)], 1) != ["survived"]:
        sys.exit(f"{subject.name}: without a fault its tests fail at the second time")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return result | {"seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime}


class Watch:
    """A plug-in of pytest: seconds of each test, and its name as coverage's context."""

    def __init__(self, cover):
        self.cover, self.seconds, self.failed = cover, {}, []

    def pytest_runtest_logstart(self, nodeid, location):
        self.cover.switch_context(nodeid)

    def pytest_runtest_logreport(self, report):
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0) + report.duration
        if report.failed:
            self.failed.append(report.nodeid)


class InOrder:
    """A plug-in of pytest: tests that cover the line first, then the others of their files, each by their seconds."""

    def __init__(self, covering: set[str], seconds: dict[str, float]):
        self.covering, self.seconds = covering, seconds

    def pytest_collection_modifyitems(self, items):
        every, files = "*" in self.covering, {test.partition("::")[0] for test in self.covering}
        items[:] = [item for item in items if every or item.nodeid.partition("::")[0] in files]
        items.sort(key=lambda item: (not every and item.nodeid not in self.covering, self.seconds.get(item.nodeid, 0)))


def covering(mutant: Mutant, timed: dict) -> set[str]:
    """Tests that reach a mutant's statement; ``*``, all: importing its module does, whichever test is the first to import it."""
    nodes = list(ast.walk(ast.parse((ROOT / mutant.file).read_text(encoding="utf-8"))))
    spans = [lines_of(node) for node in nodes if isinstance(node, ast.stmt | ast.excepthandler)]
    first, last = min((span for span in spans if span[0] <= mutant.line <= span[1]), key=lambda span: span[1] - span[0])
    lines = timed["lines"].get(mutant.file, {})
    found = {test for line in range(first, last + 1) for test in lines.get(str(line), [])}
    functions = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    by_call = any(node.body[0].lineno <= first <= last <= (node.end_lineno or 0) for node in functions)
    return found if by_call or not found else {"*"}


def lines_of(statement: ast.stmt | ast.excepthandler) -> tuple[int, int]:
    """First and last line of a statement; of one with a body, those before the body."""
    body = getattr(statement, "body", None)
    first = min([statement.lineno, *(decorator.lineno for decorator in getattr(statement, "decorator_list", ()))])
    return first, max(body[0].lineno - 1, first) if body else statement.end_lineno


def run_pytest(tests: tuple[str, ...], plugins: list, first_failure: bool = False) -> int:
    import pytest

    options = ["-q", "-n", "0", "-o", "addopts=", "-p", "no:cacheprovider", "--tb=no", "--no-header", "-m", QUICK]
    options += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # plug-ins are loaded before the first fork
    return pytest.main([*options, *(["-x"] if first_failure else []), *tests], plugins=plugins)


def silence() -> None:
    nothing = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nothing, descriptor)


def run_mutants(work: list[tuple], jobs: int) -> list[str]:
    """``killed``, ``killed by time`` or ``survived`` for each (mutant or None, tests, timing or None)."""
    outcomes = ["survived"] * len(work)
    running: dict[int, tuple[int, float, float]] = {}
    waiting = list(range(len(work)))
    while waiting or running:
        while waiting and len(running) < jobs:
            index = waiting.pop(0)
            mutant, tests, timed = work[index]
            limit_s = 3 * timed["seconds"] + 5 if timed else 60.0
            child = os.fork()
            if child == 0:
                live_as(mutant, tests, timed, limit_s)
            running[child] = (index, time.monotonic(), 10 * limit_s)
        child, status = os.waitpid(-1, os.WNOHANG)
        if child:
            index, _, _ = running.pop(child)
            if not os.WIFEXITED(status):
                outcomes[index] = "killed by time" if os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL) else "killed"
            elif os.WEXITSTATUS(status) in (4, 5) and work[index][0] is None:  # a mutant may keep conftest.py from being loaded
                sys.exit(f"no test has run: {' '.join(work[index][1])}")
            elif os.WEXITSTATUS(status) != 0:
                outcomes[index] = "killed"
            continue
        for child, (_, started, limit_s) in running.items():
            if time.monotonic() - started > limit_s:
                os.killpg(child, signal.SIGKILL)
        time.sleep(0.02)
    return outcomes


def live_as(mutant: Mutant | None, tests: tuple[str, ...], timed: dict | None, limit_s: float) -> None:
    """In a child of its own: run the tests with one changed source, and leave with pytest's exit code."""
    code = 1
    try:
        os.setpgid(0, 0)
        os.chdir(ROOT)
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s), int(limit_s) + 5))
        resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
        silence()
        if mutant is not None:
            exchange(mutant)
        plugins = []
        if timed is not None and mutant is not None:
            plugins = [InOrder(covering(mutant, timed), timed["tests"])]
        code = int(run_pytest(tests, plugins, first_failure=True))
    finally:
        os._exit(code)


def exchange(mutant: Mutant) -> None:
    """From now on, importing the mutant's file gives the changed source."""
    import cosmic_ray.plugins
    from cosmic_ray.mutating import mutate_code

    path = str(ROOT / mutant.file)
    source = mutate_code(Path(path).read_text(encoding="utf-8"), cosmic_ray.plugins.get_operator(mutant.operator)(), mutant.occurrence)
    usual = importlib.machinery.SourceFileLoader.get_code

    def get_code(self, fullname):
        return compile(source, path, "exec") if os.path.abspath(self.path) == path else usual(self, fullname)

    importlib.machinery.SourceFileLoader.get_code = get_code


if __name__ == "__main__":
    sys.exit(main())
