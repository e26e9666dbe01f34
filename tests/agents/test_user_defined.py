"""Can a controller of the user's own be scored, and are its mistakes told in plain words?"""

import importlib
import sys

import numpy as np
import pytest
from tasks import CARRIAGE_FORCE

from agents.commands import evaluate as command
from agents.control.feedback import Feedback
from agents.controllers.constant import ConstantAction
from agents.controllers.user_defined import user_defined
from agents.controllers.velocity_feedback import VelocityFeedback
from agents.evaluation.contestants import law_of
from agents.scoring import evaluate
from mm_gym import MovingMassVectorEnv, SceneError

SCENE = CARRIAGE_FORCE.replace(**{"control.steps": 20})

LAW = """
import numpy as np


class Damper:
    def __init__(self, scene):
        self.limit = scene.actuation.force.limit

    def action(self, memory, state, applied):
        return -5.0 * state[:, 2:3] / self.limit, memory
"""

CONTROLLER = """
class Still:
    name, reads = "my own", "observation"

    def __init__(self, scene):
        pass

    def begin(self, env):
        return {"steps": [0] * env.num_envs}

    def act(self, memory, observation, info):
        assert not info
        return [[0.0]] * len(memory["steps"]), {"steps": memory["steps"] + 1}
"""


def written(folder, text: str) -> str:
    (folder / "own.py").write_text(text)
    return str(folder / "own.py")


def test_law_is_scored_from_the_observation_and_from_the_true_state(tmp_path) -> None:
    bound, seen = user_defined(written(tmp_path, LAW) + ":Damper", SCENE)
    assert (bound.name, bound.reads) == ("Damper, full state", "full state")
    assert (seen.name, seen.reads) == ("Damper", "observation")
    expected = evaluate(SCENE, Feedback(SCENE, VelocityFeedback(SCENE, 5.0)), episodes=4)
    assert evaluate(SCENE, seen, episodes=4).cost == expected.cost


def test_law_is_named_wherever_a_controller_is(tmp_path) -> None:
    named = law_of(written(tmp_path, LAW) + ":Damper", SCENE, np.random.default_rng(0))
    assert (named.name, named.reads) == ("Damper", "observation")


def test_controller_is_scored_as_it_is(tmp_path) -> None:
    (own,) = user_defined(written(tmp_path, CONTROLLER) + ":Still", SCENE)
    assert (own.name, own.reads) == ("my own", "observation")
    assert evaluate(SCENE, own, episodes=4).applied.max() == 0.0
    assert own.note({}, np.zeros((4, 1))) == {}  # it has no `note`, and need not have one


def test_controller_is_told_what_is_applied_if_it_has_note(tmp_path) -> None:
    text = CONTROLLER + "\n    def note(self, memory, action):\n        return {'sent': action}\n"
    (own,) = user_defined(written(tmp_path, text) + ":Still", SCENE)
    memory = own.note({"sent": np.zeros((4, 1))}, np.full((4, 1), 0.5))
    np.testing.assert_array_equal(memory["sent"], np.full((4, 1), 0.5))


def test_controller_that_writes_into_what_it_is_given_changes_no_episode(tmp_path) -> None:
    text = CONTROLLER.replace('"observation"', '"full state"').replace(
        "        assert not info\n",
        "        observation[:] = 0.0\n        info['state'][:] = 0.0\n        info.clear()\n",
    )
    (own,) = user_defined(written(tmp_path, text) + ":Still", SCENE)
    expected = evaluate(SCENE, ConstantAction(SCENE), episodes=4)
    assert evaluate(SCENE, own, episodes=4).cost == expected.cost
    counts = LAW.replace("        return", "        memory['n'] += 1\n        return")
    counts += "\n    def begin(self, lanes):\n        return {'n': np.zeros(lanes)}\n"
    _, law = user_defined(written(tmp_path, counts) + ":Damper", SCENE)
    begun = {"law/n": np.zeros(2), **law.begin(MovingMassVectorEnv(SCENE, 2))}
    law.propose(begun, np.zeros((2, 4)), {})
    np.testing.assert_array_equal(begun["law/n"], 0.0)


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        ("-state[:, 2:3]", "got a ndarray; allowed: two things, the actions and the memory"),
        ("-state[:, 2:3], None", "got a NoneType as memory; allowed: a dict of arrays"),
        ("-state[:, 2:3], {'a': np.zeros(3)}", r"memory 'a': .*\(3,\); allowed: .* the 4 lanes"),
        ("-state[:, 2:3], {'a': ['b'] * 4}", "memory 'a': .*; allowed: numbers"),
        (
            "-state[:, 2:3], {'a': [1] * 4}",
            "memory 'a': got int64 .*; allowed: as it began, nothing",
        ),
    ],
)
def test_law_that_returns_no_memory_is_refused(returned, message, tmp_path) -> None:
    text = LAW.replace("-5.0 * state[:, 2:3] / self.limit, memory", returned)
    _, seen = user_defined(written(tmp_path, text) + ":Damper", SCENE)
    with pytest.raises(SceneError, match=message):
        evaluate(SCENE, seen, episodes=4)


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        (LAW, "Dampr", r"own\.py: it has no class or function 'Dampr'; did you mean 'Damper'"),
        (LAW, "np", "it has no class or function 'np'"),
        (LAW.replace("def action", "def actions"), "Damper", "allowed: a law .* or a controller"),
        (LAW.replace(".limit\n", ".limits\n"), "Damper", r"line 7: AttributeError"),
        (LAW.replace("scene)", "scene, gain)"), "Damper", r"TypeError: .* 'gain'"),
        ("import nothing_of_this_name", "Damper", r"line 1: ModuleNotFoundError"),
        ("class Damper(:", "Damper", r"SyntaxError"),
        ("import sys; sys.exit()", "Damper", r"line 1: SystemExit"),
        (LAW + "    name = property(lambda self: 1 / 0)", "Damper", "line 11: ZeroDivisionError"),
        (CONTROLLER.replace('"observation"', '"all"'), "Still", "reads: got 'all'; allowed: obs"),
    ],
)
def test_file_that_gives_no_controller_is_refused_with_the_reason(
    text, name, message, tmp_path
) -> None:
    with pytest.raises(SceneError, match=message):
        user_defined(f"{written(tmp_path, text)}:{name}", SCENE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LAW.replace("2:3", "2"), r"Damper: got actions of shape \(4,\); allowed: \(4, 1\).*force"),
        (LAW.replace("-5.0 *", "-5.0j *"), "Damper: got complex actions; allowed: real"),
        (LAW.replace("-5.0 *", "np.nan *"), "Damper: got actions that are not finite"),
        (LAW.replace("state[:, 2:3]", "state.velocity"), r"line 10: AttributeError.*'velocity'"),
        (LAW.replace("-5.0 * state[:, 2:3] / self.limit", "'no'"), "could not convert string"),
    ],
)
def test_law_that_fails_is_refused_with_the_reason(text, message, tmp_path) -> None:
    _, seen = user_defined(written(tmp_path, text) + ":Damper", SCENE)
    with pytest.raises(SceneError, match=message):
        evaluate(SCENE, seen, episodes=4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nowhere.py:Law", "nowhere.py: no such file"),
        ("law.py", "got 'law.py'; allowed: FILE.py:NAME"),
    ],
)
def test_command_says_what_is_wrong_with_its_argument(text, message, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["evaluate", "mm_gym/CarriageForce-v0", "--controller", text]
    monkeypatch.setattr(sys, "argv", arguments)
    assert message in str(command.main())


def test_command_ranks_it_among_the_baselines(tmp_path, monkeypatch, capsys) -> None:
    still = Feedback(CARRIAGE_FORCE, VelocityFeedback(CARRIAGE_FORCE, 0.1))
    monkeypatch.setattr(command, "baselines", lambda _: ([still], {}))
    own = written(tmp_path, LAW) + ":Damper"
    monkeypatch.setattr(
        sys,
        "argv",
        [
            *("evaluate", "mm_gym/CarriageForce-v0", "--controller", own, "--episodes", "5"),
            *("--out", str(tmp_path / "out")),
        ],
    )
    assert command.main() is None
    printed = capsys.readouterr().out
    assert printed.index("Damper") < printed.index("velocity feedback")
    assert "full state" in printed
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {"scores.csv", "episodes.csv", "costs.png", "response.png"}


def test_python_looks_for_new_modules_after_this_package_is_imported():
    importlib.invalidate_caches()  # as notebooks and pytest do: it asks all that finds modules
