"""The docstring of the environment, which is its manual, agrees with the scene."""

import re

from mm_gym import MovingMassEnv
from mm_gym.scene import Actuation, Sensors


def names_in(table):
    """The names in the first column of the docstring's table that begins with this heading."""
    text = re.search(rf"\n +{table} .*\n +=+ +=+.*\n((?:.*\n)*?) +=+ ", MovingMassEnv.__doc__)
    rows = text[1].splitlines()
    column = len(re.search(rf"\n( +{table} +)", MovingMassEnv.__doc__)[1])
    return re.findall(r"[a-z]+(?:_[a-z]+)*", " ".join(row[:column] for row in rows))


def test_every_channel_is_listed():
    choices = Sensors.model_json_schema()["properties"]["channels"]["items"]["enum"]
    words = names_in("channel")
    assert set(choices) <= set(words)
    assert {word for word in words if "_" in word} <= set(choices)


def test_every_actuator_is_listed():
    assert names_in("column") == list(Actuation.model_fields)
