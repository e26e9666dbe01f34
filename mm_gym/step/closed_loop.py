"""Episodes under a law that is compiled too: no Python between their control steps."""

from __future__ import annotations

from mm_gym.compiler.addresses import call, call_and_tell
from mm_gym.compiler.jit import borrowing_kernel
from mm_gym.lanes import layout
from mm_gym.lanes.memory import span

LAW_FAILED = -1
"""Status, if the law raises an error."""


@borrowing_kernel
def run(law, law_arguments, step, step_arguments, rewarding, its_arguments, found):
    """Take lanes through their episodes to the end.

    Parameters
    ----------
    law, step, rewarding : int
        Addresses: of a function that writes the actions; of the kernel of a control step; of a
        kernel that returns a status, and may replace the rewards.
    law_arguments, step_arguments, its_arguments : tuple
        All of their arguments.
    found
        (lanes,) each, written: sum of the rewards, least reward, number of control steps, and
        whether the episode was terminated.
    """
    _, _, lanes, _, ends, _, _, rewards, _, count = step_arguments
    returns, least, lengths, terminated = found
    for i in span(0, count):
        returns[i], least[i], lengths[i], terminated[i] = 0.0, 0.0, 0, False
    steps, running = 0, count
    while running > 0:
        if call_and_tell(law, law_arguments):
            return LAW_FAILED
        status = call(step, step_arguments)
        if status <= layout.ENDED:
            status = max(status, call(rewarding, its_arguments))
        if status > layout.ENDED:
            return status
        steps += 1
        for i in span(0, count):
            reward = rewards[i] if lengths[i] == 0 else 0.0
            returns[i] += reward
            least[i] = min(least[i], reward)
        if status == layout.ENDED:
            running -= _end(lanes, ends, steps, lengths, terminated)
    return layout.OK


@borrowing_kernel
def _end(lanes, ends, steps, lengths, terminated):
    """Note the episodes that a step ends, and let their lanes rest; return how many there are."""
    ended = 0
    for i in span(0, lengths.shape[0]):
        if ends[layout.TERMINATED, i] or ends[layout.TRUNCATED, i]:
            if lengths[i] == 0:
                lengths[i], terminated[i] = steps, ends[layout.TERMINATED, i]
                ended += 1
            for row in range(4):  # its motion must not make a step fail
                lanes[row, i] = 0.0
    return ended
