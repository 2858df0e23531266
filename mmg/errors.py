"""The one error that users meet: a line that says what is wrong, where, and what to do."""


class UserError(Exception):
    """Bad input or an impossible request.

    The command line prints its text as one line and exits with code 2; the library raises it.
    The text says what is wrong, where (file, column, row, key), and what to do about it.
    """
