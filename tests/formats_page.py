"""docs/formats.md and the pages below it as data: keys of each JSON format, effects with parameters, which keys of a table they lack; and
docs/make_schemas.py."""

import importlib.util
import json
import re
from functools import cache
from pathlib import Path

from feature import feature
from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match
from referencing import Registry, Resource

import calibrate
from tinygc import FitOptions

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "docs" / "formats.md", *sorted((ROOT / "docs" / "formats").glob("*.md"))]
PAGE = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
SCHEMA = re.compile(r"tinygc-[a-z]+(?:-[a-z]+)*/\d+")
CODE = re.compile(r"`([^`]+)`")


def section(heading):
    """What stands below a heading, up to the next one."""
    found = re.search(rf"^#+ {re.escape(heading)}$\n(.*?)(?=^#|\Z)", PAGE, re.M | re.S)
    if found is None:
        raise LookupError(f"docs/formats.md has no section {heading!r}")
    return found.group(1)


def rows(heading):
    """Cells of the table in a section, without its head, or of its list: key and meaning."""
    lines = [line for line in section(heading).splitlines() if line.startswith(("|", "- `"))]
    if lines[0].startswith("- "):
        return [line.removeprefix("- ").split(": ", 1) for line in lines]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines[2:]]


@cache
def maker():
    """docs/make_schemas.py."""
    spec = importlib.util.spec_from_file_location("make_schemas", ROOT / "docs" / "make_schemas.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def keys_on_page(schema):
    if typed := maker().typed_keys().get(schema):
        return list(typed)
    return [tuple(path.split(".")) for row in rows(f"`{schema}`") for word in CODE.findall(row[0]) for path in maker().expanded(word)]


#: effect -> names of its parameters in JSON
EFFECTS = {CODE.findall(row[0])[0]: set(CODE.findall(row[1])) for row in rows("Effects")}
(TABLE_LINE,) = (line for line in section("`tinygc-explain/2`").splitlines() if line.startswith("`<parameter>` of a table"))
PARAMETERS = set().union(*EFFECTS.values(), CODE.findall(TABLE_LINE)[1:])
(METHOD_LINE,) = (line for line in section("`tinygc-fit/2`").splitlines() if line.startswith("`<method>` is"))
METHODS = set(CODE.findall(METHOD_LINE)[1:])
OPTIONS = {path[1] for path in keys_on_page("tinygc-truth/1") if path[0] == "options" and len(path) > 1}
STANDS_FOR = {
    "<method>": lambda word: word in METHODS,
    "<file>": lambda word: re.fullmatch(r"[\w-]+(\.unit\d+)?\.(csv|csv\.gz|toml|json)", word),
    "<id>": lambda word: word in EFFECTS or word.startswith("unknown."),
    "<parameter>": lambda word: word in PARAMETERS,
    "<option>": lambda word: word in OPTIONS,
    "<option of a fit>": lambda word: word in FitOptions.__dataclass_fields__,
    "<quantity>": lambda word: re.fullmatch(r"(gyro|accel)_\w+_(ppm|mrad|mdps|mg)", word),
    "<coefficient>": lambda word: re.fullmatch(r"dps\w*", word),
    "<cause>": lambda word: re.fullmatch(r"[a-z][a-z0-9 _-]*", word),
    "<constant>": lambda word: re.fullmatch(r"[a-z][a-z0-9_]*", word),
    "<follows>": lambda word: word in feature("tinygc.features.discovery.quantities").QUANTITIES,
    "<full scale>": lambda word: re.fullmatch(r"\d+(\.\d+)?", word),
    "<length>": lambda word: re.fullmatch(r"\d+(\.\d+)?", word),
}


def fits(word, pattern):
    return bool(STANDS_FOR[pattern](word)) if pattern in STANDS_FOR else word == pattern


def leaves(value, path=()):
    """(path, value) of everything in a table that is no table itself, and of every table within it that has a schema of its own."""
    if isinstance(value, dict) and value and not (path and "schema" in value):
        for key, inner in value.items():
            yield from leaves(inner, (*path, key))
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for inner in value:
            yield from leaves(inner, (*path[:-1], f"{path[-1]}[]"))
    else:
        yield path, value


@cache
def validators():
    """Format -> what holds a table against its schema."""
    schemas = maker().schemas()
    registry = Registry().with_resources((name, Resource.from_contents(schema)) for name, schema in schemas.items())
    return {schema["title"]: Draft202012Validator(schema, registry=registry) for schema in schemas.values()}


def strangers(table):
    """What of a table the pages or its schema do not know."""
    wrong = best_match(validators()[table["schema"]].iter_errors(table))
    return unknown_keys(table) + ([] if wrong is None else [f"{wrong.json_path}: {wrong.message[:300]}"])


def unknown_keys(table):
    """Keys of a table that its section of the page does not have."""
    known, missing = keys_on_page(table["schema"]), []
    for path, value in leaves(table):
        if isinstance(value, dict) and "schema" in value:
            missing += [f"{'.'.join(path)}: {word}" for word in unknown_keys(value)]
        # Nothing, or an empty list, stands for all that could be in it.
        whole = value not in (None, [], {})
        if not any(_matches(path, pattern, whole) for pattern in known):
            missing.append(".".join(path))
    return missing + [f"{effect['id']}: {name}" for effect, name in _parameters(table) if name not in EFFECTS.get(effect["id"], {name})]


def _matches(path, pattern, whole):
    if len(path) > len(pattern) or (whole and len(path) < len(pattern)):
        return False
    pattern = pattern[: len(path)]
    last = pattern[-1] if whole else pattern[-1].removesuffix("[]")
    return all(map(fits, path, (*pattern[:-1], last)))


def _parameters(table):
    """(effect, name) of each parameter of a claimed effect."""
    for group in ("effects", "findings", "refused"):
        for effect in table.get(group, ()):
            if isinstance(effect, dict) and "parameters" in effect:
                yield from ((effect, name) for name in {**effect["parameters"], **effect["std"]} if not effect["id"].startswith("unknown."))


def told(out, *words):
    """The JSON of a command, which has the keys of its page."""
    assert calibrate.main([*map(str, words), "--quiet", "--json", str(out)]) == 0
    table = json.loads(out.read_text(encoding="utf-8"))
    assert strangers(table) == []
    return table
