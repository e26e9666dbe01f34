"""A control step: command, excite, move, observe, score, end, restart; and closed loops.

Arguments that the kernels have in common:

- `task` (t,) and `model` (m,), read: the constants of `mm_gym.lanes.layout`; `constants` (t + m,)
  are both, one behind the other.
- `lanes` (rows, count), read and written: rows of `mm_gym.lanes.layout`.
- `frames` (frames * channels, count) float32, written: observations, oldest frame first. Where
  lanes have sensors of their own, the frames observed come first, and behind them those on the way,
  as many as the largest delay and one. The newest frame begins at row `newest`.
- `ends` (3, count) bool, written: terminated, truncated, and whether one of the block is marked.
- `streams` (2, count) uint64, read and written: random numbers.
- `actions` (actuators * count,) float32 or float64, read: in [-1, 1] or clipped to it, those of the
  force, of the stretch, then of the damping or voltage.
- `rewards` (count,), written.
- `which` (b,) int64, read: lanes in ascending order.
- `first`, `last`: the lanes first .. last - 1, of one block where the block's clock is read; with
  `which`, those of them that are listed. `i`: one lane.

A kernel that returns an integer and says no more of it returns a status, of several the largest.
"""
