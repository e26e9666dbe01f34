"""What the tests of agents share."""

import signal

import pytest


@pytest.fixture
def ctrl_c():
    """Let Ctrl-C interrupt, even where a shell that runs the tests in the background ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
