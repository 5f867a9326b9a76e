"""The searches are started from the command line; pytest has nothing to collect in them."""

collect_ignore = ["channels.py", "inputs.py", "manual.py", "soak.py"]
