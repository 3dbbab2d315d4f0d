"""Beyond the catalogue (docs/discover.md): find the equation that was left out, write it down as an effect, and prove it.

From below: ``grammar``, what can be said; ``screen``, all of it by its linear columns, and what chance makes of them; ``judge``, the best
of it refitted exactly and held against what the search never saw; ``told``, the answer as a file, in words and in pictures.

May import: session, attitude, effects, models, closure, problem, explanation, plan.
"""
