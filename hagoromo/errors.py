"""The one exception for what a user can mend: it says what is wrong, what was given, what to do."""


class InputError(ValueError):
    """Bad input. The message is one line; the command line prints it and ends with exit status 2."""
