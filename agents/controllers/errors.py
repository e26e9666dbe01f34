"""What a design raises."""


class DesignError(ValueError):
    """A controller cannot be designed for the scene; the message says why."""
