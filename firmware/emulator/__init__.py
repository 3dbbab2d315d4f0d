"""A test kit, no part of the product: what an STM32F405 and its sensor are to the firmware's ELF file (docs/firmware.md)."""
