"""What excites a scene, as it runs: its kinds, and the polynomials that methods read.

Arguments that the kernels have in common:

- `model` (m,), read, at whose end the excitation is described: `slot` is the first slot of a part
  there, `own` the first of the slots that only its kind has.
- `lanes` (rows, count), read and written: `row` is the first of a part's rows, `jet` that of the
  jet to which it adds.
- `streams` (2, count) uint64, read and written: random numbers.
- `which` (b,) int64, read: lanes in ascending order; `first`, `last`: the lanes first .. last - 1,
  of one block where the block's clock is read; `i`: one lane; `i`, `count`: so many from there on.
- `clock`: the control steps made so far, the sample intervals of each, and the index of the present
  one, `interval`, within its control step; `count`, if not of lanes: the number of a sample
  interval in the episode; `step`: the length of one [s].
- `began`: start of what is looked at since that of the episode [s]; `elapsed`, `duration`: times
  since the start of the sample interval, or a start there and a length [s].
"""
