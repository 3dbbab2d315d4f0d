"""Models: a map from measured rates to calibrated ones, and the file that each kind is kept in."""

from tinygc.models.files import from_dict, load, load_with_table, to_dict

__all__ = ["from_dict", "load", "load_with_table", "to_dict"]
