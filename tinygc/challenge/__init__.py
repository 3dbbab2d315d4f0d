"""``calibrate.py challenge``: the tool's own blind examination, for whoever doubts it.

``conceal`` draws what each simulated session hides (``concealment`` is one hidden thing; ``rate_effects``, ``other_effects`` and
``outsiders`` make them), ``seal`` closes the truth away, ``worker`` explains one session folder in a process of its own that is given
nothing else, ``score`` compares, ``table`` prints; ``examine`` is all of it in order.

What is concealed here is computed by code of its own, on the simulation's fine grid or on its registers: the catalogue in
``tinygc.effects`` is not asked, only told which folders to look into.

May import: session, effects, explanation, simulation.
"""
