"""Are copies of rows to columns the rows, for any number of rows and any range of lanes?"""

from __future__ import annotations

import numpy as np
import pytest

from mm_gym.lanes.transposition import copy_as_columns

LANES = 45


@pytest.mark.parametrize("count", range(1, 20))
def test_columns_are_the_rows(count: int) -> None:
    rng = np.random.default_rng(0)
    rows = rng.random((count + 2, LANES), np.float32)
    # Whole squares, lanes left over before and behind, fewer lanes than a square, and none.
    for first, last in ((0, 40), (3, 32), (8, LANES), (40, 43), (7, 7)):
        copy = np.full((LANES, count), -1.0, np.float32)
        copy_as_columns(rows, copy, first, last)
        assert np.array_equal(copy[first:last], rows[:count, first:last].T)
        assert np.all(copy[:first] == -1.0)
        assert np.all(copy[last:] == -1.0)
