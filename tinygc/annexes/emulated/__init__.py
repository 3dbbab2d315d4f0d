"""The real board's firmware on an emulated STM32F405, with a register model of the ASM330LHH."""
