"""Models: maps from measured rates to calibrated ones, and the files of each kind."""

from tinygc.models.files import from_dict, load, load_with_table, to_dict

__all__ = ["from_dict", "load", "load_with_table", "to_dict"]
