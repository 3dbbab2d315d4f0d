"""An STM32F405 that runs the real board's ELF file, unmodified, on simulated time.

``elf`` -> ``cpu`` (Unicorn: instructions and memory) with ``counter`` -> ``clock`` (events by cycle) ; ``core`` and ``nvic`` (SysTick,
CYCCNT, exceptions), ``bus`` (RCC, each peripheral's clock), ``gpio``, ``dma``, ``spi``, ``usart`` -> ``machine`` (all of it).

Time is the number of executed instructions times ``machine.CYCLES_PER_INSTRUCTION``, at 168 MHz from the first instruction on.  ``wfi``
lets time pass to the next event.  A loop of short turns (``clock.TURN``) that reads the same from a status register again and again is
spared the turns until that peripheral's next change, or until the next event: the time passes, its turns are not run.  A wait for
something that will never come is run turn by turn, so a bound on its turns means what it means on a board.

Bytes are exchanged with a DMA stream in bulk, each at its own time.  What a program does that the part does not allow, or that would not
work on a real board (a peripheral without its clock, a pin that is not the peripheral's, a chip select that moves amid a byte, a stream
over a memory that it cannot reach, a buffer that is changed while it is sent), stands in ``Bus.objections``.

Not emulated: the process stack, faults as exceptions (they end the run with a ProgramError), bit-banding, the memory protection unit,
watchdogs, DMA1, other timers than SysTick, circular and memory-to-memory DMA, reception by DMA on the USARTs.
"""
