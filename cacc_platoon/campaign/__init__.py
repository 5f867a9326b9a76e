"""Fault campaigns: what happens to running platoons, and what has to come of it.

The plan (`plan`), the table of what may come of each fault (`table`) and the judgement (`check`)
are pure. `trial` does one fault to one real platoon, in a process of its own, through `testing`;
`trials` starts those.
"""
