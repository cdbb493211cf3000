"""What a reader says of a file that it cannot read."""

import pytest

from rotorfit.errors import LogError
from rotorfit.logs import read_log


def error_of(path, *, options=None):
    """Return the one line that names the file and the fault, without the file."""
    with pytest.raises(LogError) as caught:
        read_log(path, options=options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")
