"""Shell scripts that complete the command line, generated from its parser: no Python runs when the user presses Tab.

bash gets a function of cases; zsh uses the same through its ``bashcompinit``; fish gets a line for each option.  An argument without
completions of its own is a file, unless the option takes a number or a free name.
"""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator

from session.base.options import file_written, folder_written, log_written, path_read

#: possible names of the program
NAMES = ("calibrate", "calibrate.py")
PATHS = (file_written, folder_written, log_written, path_read)
#: paths, though their type is text: a serial port
PORTS = ("port",)

_BASH = """\
_calibrate_complete() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD-1]}} command= options= words= i
    for ((i = 1; i < COMP_CWORD; i++)); do
        case ${{COMP_WORDS[i]}} in -*) ;; *) command=${{COMP_WORDS[i]}}; break ;; esac
    done
    case " {pairs} " in *" $command-${{COMP_WORDS[i+1]}} "*) command="$command ${{COMP_WORDS[i+1]}}" ;; esac
    COMPREPLY=()
    case $command in
{commands}
    *)  options="--help --version --completion" words="{names}" ;;
    esac
    case "$command $previous" in
{values}
    *)  case $current in -*) words=$options ;; esac ;;
    esac
    [ -n "$words" ] && COMPREPLY=($(compgen -W "$words" -- "$current"))
    return 0
}}
complete -o default -o bashdefault -F _calibrate_complete {called}
"""


def script(shell: str, whole: argparse.ArgumentParser) -> str:
    """Return the script of bash, zsh or fish."""
    if shell == "fish":
        return "\n".join(_fish(whole)) + "\n"
    text = _bash(whole)
    return f"autoload -U +X bashcompinit && bashcompinit\n{text}" if shell == "zsh" else text


def commands_of(whole: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return name -> parser."""
    (group,) = (action for action in whole._actions if isinstance(action, argparse._SubParsersAction))
    return dict(group.choices)


def _bash(whole: argparse.ArgumentParser) -> str:
    commands, values = [], []
    known = commands_of(whole)
    for name, command in known.items():
        flags = [flag for action in command._actions for flag in action.option_strings if flag.startswith("--")]
        words = " ".join(str(choice) for action in command._actions if not action.option_strings for choice in action.choices or ())
        words = " ".join([words, *(other.split()[1] for other in known if other.startswith(f"{name} "))]).strip()
        commands.append(f'    "{name}") options="{" ".join(flags)}" words="{words}" ;;')
        for action in command._actions:
            if not action.option_strings or action.nargs == 0:
                continue
            cases = "|".join(f'"{name} {flag}"' for flag in action.option_strings)
            if action.choices:
                values.append(f'    {cases}) words="{" ".join(map(str, action.choices))}" ;;')
            elif _is_path(action):
                values.append(f"    {cases}) words= ;;")
            elif action.nargs != "?":
                values.append(f"    {cases}) compopt +o default +o bashdefault 2>/dev/null; return 0 ;;")
    names = " ".join(name for name in known if " " not in name)
    pairs = " ".join(name.replace(" ", "-") for name in known if " " in name)
    return _BASH.format(commands="\n".join(commands), values="\n".join(values), names=names, pairs=pairs, called=" ".join(NAMES))


def _is_path(action: argparse.Action) -> bool:
    return action.type in PATHS or action.dest in PORTS


def _fish(whole: argparse.ArgumentParser) -> Iterator[str]:
    summaries = {choice.dest: choice.help or "" for group in whole._actions for choice in getattr(group, "_choices_actions", ())}
    for called in NAMES:
        begins = f"complete -c {called}"
        yield f"{begins} -n __fish_use_subcommand -f -l version -d 'print the version'"
        yield f"{begins} -n __fish_use_subcommand -x -l completion -a 'bash zsh fish' -d 'print what makes a shell complete'"
        for name, command in commands_of(whole).items():
            if " " not in name:
                yield f"{begins} -n __fish_use_subcommand -f -a {name} -d {shlex.quote(summaries.get(name, ''))}"
            first, _, second = name.partition(" ")
            seen = f"__fish_seen_subcommand_from {first}" + (f"; and __fish_seen_subcommand_from {second}" if second else "")
            inside = f"{begins} -n '{seen}'"
            if second:
                yield f"{begins} -n '__fish_seen_subcommand_from {first}' -f -a {second} -d {shlex.quote(summaries.get(name, ''))}"
            for action in command._actions:
                yield from _fish_action(inside, action)


def _fish_action(inside: str, action: argparse.Action) -> Iterator[str]:
    choices = " ".join(map(str, action.choices or ()))
    if not action.option_strings:
        if choices:
            yield f"{inside} -f -a '{choices}'"
        return
    flags = " ".join(f"-l {flag[2:]}" if flag.startswith("--") else f"-s {flag[1:]}" for flag in action.option_strings)
    value = "" if action.nargs in (0, "?") else " -r -F" if _is_path(action) else f" -x -a '{choices}'" if choices else " -x"
    about = "" if action.help in (None, argparse.SUPPRESS) else (action.help or "").split(";")[0].split(" (")[0].replace("%%", "%")
    yield f"{inside} {flags}{value} -d {shlex.quote(about)}"
