"""The sensor's driver is for any C99 target: other widths of int, other signs of char, other sizes of an enumeration."""

import shutil
from functools import cache

import pytest
from conftest import ROOT
from processes import run

DRIVER = sorted((ROOT / "firmware").glob("lsm6dsx*.c"))
FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-ffreestanding")
#: name -> compiler and its options: int and pointers of 16 bits, of 32; chars without a sign and enumerations of a byte.  On the ATmega
#: without -pedantic: enumeration constants of more than 15 bits are an extension there that its compilers have.
TARGETS = {
    "ATmega2560": ("avr-gcc", "-mmcu=atmega2560"),
    "Cortex-M0+": ("arm-none-eabi-gcc", "-mcpu=cortex-m0plus", "-mthumb", "-pedantic"),
    "32 bits": ("gcc", "-m32", "-pedantic"),
    "unsigned char, short enum": ("gcc", "-funsigned-char", "-fshort-enums", "-pedantic"),
    "signed char, 64 bits": ("gcc", "-fsigned-char", "-pedantic"),
}

pytestmark = pytest.mark.emulation  # with the tools that the firmware is built with


@cache
def builds(compiler):
    """Whether the compiler is there and has the headers for these options."""
    if shutil.which(compiler[0]) is None:
        return False
    empty = run([*compiler, *FLAGS, "-fsyntax-only", "-x", "c", "-"], input="#include <stdint.h>\n", capture_output=True, text=True)
    return empty.returncode == 0


@pytest.mark.parametrize("target", TARGETS)
def test_the_driver_compiles_without_a_warning(target, tmp_path):
    compiler = TARGETS[target]
    if not builds(compiler):
        pytest.skip(f"not installed: {' '.join(compiler)}")
    assert DRIVER
    made = run([*compiler, *FLAGS, "-c", *DRIVER], cwd=tmp_path, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
