"""Colours that mean the same in every panel."""

AXES = {"x": "#c0392b", "y": "#27804a", "z": "#2c5fa8"}
BEFORE, AFTER, FLOOR, PALE = "#c0392b", "#2c5fa8", "#777777", "#bbbbbb"
