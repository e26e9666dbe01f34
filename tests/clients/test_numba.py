"""The page on numba as it is printed."""

from pages import run_page


def test_law_that_damps_returns_more_than_none(tmp_path):
    without, with_it = map(float, run_page("numba", tmp_path).split())
    assert without < with_it < 0.0
