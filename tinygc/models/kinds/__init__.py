"""How each kind of model is written to its file and read from it; ``tinygc/models/files.py`` is the front door."""
