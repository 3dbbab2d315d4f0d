"""``make flash``: what the flashers are asked to do.  They are scripts here that note how they were called."""

import shutil
import stat
import sys

import pytest
from conftest import ROOT
from processes import environment, run

if shutil.which("make") is None or sys.platform == "win32":
    pytest.skip("needs make and a shell", allow_module_level=True)


CALLS = {
    "dfu-util": "-a 0 -s 0x08000000:leave -D {build}/{name}.bin",
    "openocd": "-f interface/stlink.cfg -f target/stm32f4x.cfg -c program {build}/{name}.elf verify reset exit",
    "st-flash": "--reset write {build}/{name}.bin 0x08000000",
}
#: of make and of its recipes
NEEDED = ("sh", "make", "mkdir", "cmp", "echo")
COMPILER = 'while [ "$#" -gt 1 ]; do [ "$1" = -o ] && : > "$2"; shift; done'
OBJCOPY = ': > "$4"'


def script(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


@pytest.fixture
def bench(tmp_path):
    """``bench(tools, *words)``: make with these flashers on the PATH and no others; compilers write empty files."""
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in NEEDED:
        (tools / name).symlink_to(shutil.which(name))
    script(tools / "compiler", COMPILER)
    script(tools / "objcopy", OBJCOPY)
    (tmp_path / "model").mkdir()
    for ending in "ch":
        (tmp_path / "model" / f"tinygc_model.{ending}").touch()

    def make(flashers, *words):
        for name in flashers:
            script(tools / name, f'echo "$*" >> "{tmp_path}/{name}.calls"')
        options = [f"BUILD={tmp_path}/build", f"MODEL={tmp_path}/model", "CC=compiler", "OBJCOPY=objcopy", "SIZE=:"]
        command = ["make", "-s", "-C", ROOT / "firmware", *options, *words]
        ran = run(command, capture_output=True, text=True, env=environment(PATH=str(tools)))
        calls = {path.stem: path.read_text().splitlines() for path in tmp_path.glob("*.calls")}
        return ran, calls, tmp_path / "build"

    return make


@pytest.mark.parametrize(
    ("tool", "target", "name"),
    [("dfu-util", "flash", "tinygc"), ("openocd", "flash-recorder", "recorder"), ("st-flash", "flash", "tinygc")],
)
def test_whichever_is_installed_is_called_as_it_wants(bench, tool, target, name):
    ran, calls, build = bench([tool], target)
    assert ran.returncode == 0, ran.stderr
    assert calls == {tool: [CALLS[tool].format(build=build, name=name)]}
    assert (build / f"{name}.elf").exists()
    assert (build / f"{name}.bin").exists()
    assert tool in ran.stdout
