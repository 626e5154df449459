"""Errors a user can cause. Each carries one line that names the file, key or message and says what to do."""

TOO_LARGE = "the log needs more memory than there is"
"""Begins the line of a command that ran out of memory."""


class UserError(Exception):
    """Base of every error that is reported as one line, without a traceback.

    ``exit_code`` is the documented exit code of the command that meets it.

    Examples
    --------
    >>> import replay
    >>> from models.common.errors import UserError
    >>> try:
    ...     replay.load("no_such_flight.tlog")
    ... except UserError as error:
    ...     print(error.exit_code, error)
    3 no_such_flight.tlog: cannot be read (No such file or directory)
    """

    exit_code = 2


class ConfigError(UserError):
    """A vehicle file or an argument is wrong."""


class ModelError(UserError):
    """A data set or a model directory is wrong, or of another schema."""


class NotFittedError(UserError):
    """An estimator is asked before it was fitted."""


class LogError(UserError):
    """A log cannot be read, or lacks the messages the task needs."""

    exit_code = 3


class LinkError(UserError):
    """A link could not be opened."""

    exit_code = 4
