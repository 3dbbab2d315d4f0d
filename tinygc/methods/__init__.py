"""The methods of a fit, run by the names in ``tinygc/estimation/options.py``."""
