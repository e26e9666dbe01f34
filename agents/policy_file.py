"""What the files of all kinds of policies have in common."""

LARGEST = 64 * 2**20
"""Size of a file [bytes], and of what it unpacks to; a policy of two layers of 64 has 40 kB."""


class PolicyError(RuntimeError):
    """A policy cannot be read, or does not suit the scene."""
