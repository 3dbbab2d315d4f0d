"""The real board's firmware on an emulated STM32F405, with the register model of an ASM330LHH that turns on the simulator's table.

``replayed`` (a session as what the sensor feels) -> ``board`` (firmware, sensor and motion behind a pseudo-terminal, paced by the clock).
The ELF file is the one that is flashed to a board; a recorder at the other end cannot tell the two apart, but for the time that a busy
machine lets it wait.
"""
