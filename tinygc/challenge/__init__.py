"""``calibrate.py challenge``: the tool's own blind examination, for whoever doubts it.

``conceal`` simulates what each session hides (``concealment`` is one hidden thing; ``rate_effects``, ``other_effects`` and
``outsiders`` make them), ``seal`` closes the truth away, ``worker`` explains one session folder in a process of its own that is given
nothing else, ``score`` compares (``reliability``, ``splits``), ``table`` prints; ``examine`` is all of it in order.  ``cases`` draws what
is hidden.  ``on_recording`` conceals in a recording of the user's own, and says what that one can tell.  ``discover`` examines the search
for laws that stand in no catalogue.

What is concealed here is computed by code of its own, on the simulation's fine grid or on its registers: the catalogue in
``tinygc.effects`` is not asked, only told which folders to look into.

May import: session, effects, problem, explanation, discovery, simulation.
"""
