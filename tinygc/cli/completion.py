"""Shell scripts that complete the command line, generated from its parser: no Python runs when the user presses Tab.

bash gets a function of cases; zsh uses the same through its ``bashcompinit``.  An argument without completions of its own is a file,
unless the option takes a number or a free name.
"""

from __future__ import annotations

import argparse

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
    """Return the script of bash or zsh."""
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
