"""The root of every error that a user can put right."""


class UserError(Exception):
    """Bad input: one line that names the value, the rule, the consequence and the remedy."""
