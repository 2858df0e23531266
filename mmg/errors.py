"""The one error that users meet: a line that says what is wrong, where, and what to do."""


class UserError(Exception):
    """Bad input or an impossible request.

    The command line prints its text as one line and exits with code 2; the library raises it.
    The text says what is wrong, where (file, column, row, key), and what to do about it.
    """


def needs_torch(what: str) -> None:
    """Raises UserError where torch, which ``what`` needs, is missing or broken."""
    try:
        import torch  # noqa: F401
    except (ImportError, OSError) as error:
        raise UserError(f"{what} needs torch, which cannot be imported ({error}); pip install torch") from None
