"""A session that nobody recorded: a hand-turned three-axis table under an ASM330LHH.

``options`` -> ``table_movement`` (what the hand does, a sum of ``stroke``) -> ``motion`` (exact attitude, rate, force) -> ``sensor``
(errors of one drawn ``unit``, ``noise``, low-pass, registers) -> ``simulate`` (all of it) -> ``write`` (the session folder).
The rest of the project reads that folder as it reads a recorded one; ``truth.json`` in it is for tests and demonstrations only.

Physics that the linear model leaves out enters by ``distort``, a function that the caller gives: no effect is known here by name.
Conventions are those of ``session``'s docstring.  Import from the modules: ``options.SimulationOptions``,
``simulate.simulate_session``, ``write.write_session``; the first costs nothing, the others import scipy.signal.

May import: session.
"""
