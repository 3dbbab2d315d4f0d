"""A register model of the ASM330LHH behind its SPI port: an independent judge of drivers, and the heart of an emulated board.

``registers`` (the map: names, fields, codes) -> ``motion`` (what the sensor feels) -> ``readings`` (int16 at the true sample times) and
``fifo`` (tagged words) -> ``sensor`` (all of it on simulated time) -> ``port`` (bytes over SPI) ; ``faults`` says what goes wrong, when.

No file here has seen a driver.  What the project's page of the sensor's public facts says holds as it stands there: addresses, fields,
codes, sensitivities, the true data rate 6667 (1 + 0.0015 f) / coefficient, the tick of the timestamp 1 / (40000 (1 + 0.0015 f)) s, the
tags, the read bit, the wrap from 0x7E to 0x78.  **What it leaves open is assumed here, once**; most of it is what the family's data
sheets say, from memory:

- Defaults: PIN_CTRL 0x3F, CTRL3_C 0x04 (``if_inc``), CTRL9_XL 0xE0, all others 0.  ``sw_reset`` restores them at once, and reads 1 for
  50 us more; ``boot`` reads 1 for 10 ms and changes nothing else.  After power-up or a reset by itself every register reads 0, and
  writes are lost, for 10 ms.
- Both sensors and the FIFO share one divider of the 6667 Hz clock, which begins when the first of them is switched on; the first sample
  comes one period later and is good (no settling).  No filter is modelled: the registers of filters are kept, and do nothing.
- The frequency that INTERNAL_FREQ_FINE states is the true one, but for ``Oscillator.residual_ppm``; it may differ between off and on.
- The FIFO holds 512 words (3 kB of data; the 9 bits of its watermark reach 511).  Words of one time slot come in the order of
  ``batching.ORDER`` (timestamp, temperature, gyroscope, accelerometer; a test can ask for another) and share TAG_CNT, which counts the
  slots of the fastest batch rate.  The parity bit makes the number of ones of the tag byte even.  An empty FIFO reads as zeros.  A word
  is fixed when its tag is read, and gone when its byte 0x7E has been.
- Batched temperature: each 128th, 512th, 4096th tick of the 6667 Hz clock (52, 12.5, 1.6 Hz), or each slot where these are rarer; the
  register in the first two bytes, zeros behind.  Timestamps: each slot, each 8th, each 32nd, while ``timestamp_en``; four bytes and two
  zeros.  A batch rate above the data rate gives the data rate; the gyroscope's 6.5 Hz (code 11) is each 1024th tick; code 11 of the
  accelerometer, which this part lacks, gives nothing.
- FIFO modes: 0 bypass (empties it), 1 until full, 6 continuous; 3 is taken for 6, and 4 and 7 for bypass, since no event triggers here.
- ``fifo_ovr_ia``: a word was lost and no room has been made since.  ``over_run_latched``: the same until FIFO_STATUS2 has been read.
  ``fifo_full_ia``: the next slot would not fit.  ``fifo_wtm_ia``: at least the watermark's words, which is not 0.
- STATUS bits fall when a high byte of that sensor's output is read.  With ``bdu`` a register that was read by half keeps its value until
  its other half is read.
- INT1 is the or of what INT1_CTRL lets through, low with ``h_lactive``; ``dataready_pulsed`` makes the data-ready part 75 us long.
- Self-test: st_xl 1 and 2 add and subtract, st_g 1 and 3 add and subtract (``SelfTest``: 500 mg, 400 dps); other codes do nothing.
- The timestamp stands at 0 without ``timestamp_en``; 0xAA written to 0x42 sets it to 0.  Behind 0x7F an address goes on at 0x00.
- User offsets, high-pass, DEN, ``drdy_mask``, ``rounding``, the 3-wire SPI and INT2 are kept in their registers and do nothing.
"""
