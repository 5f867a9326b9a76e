"""Figures: each function takes a record and axes, and draws; computing is done elsewhere."""
