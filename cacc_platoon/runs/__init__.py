"""A run on disk: its folder, its parts while it runs, what a bag says of it.

Nothing is imported here: hosts need `runs.parts` alone, and have to start fast.
"""
