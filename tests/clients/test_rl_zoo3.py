"""Do the pages on rl-zoo3, sb3-contrib and SBX work as they are printed?"""

from pages import run_page


def test_blocks_of_the_page_on_rl_zoo3_run(tmp_path):
    printed = run_page("rl-zoo3", tmp_path)
    assert "Mean episode length: 400.00" in printed
    assert (tmp_path / "logs" / "ppo" / "mm_gym-PreStretch-v0_1").is_dir()


def test_blocks_of_the_page_on_sb3_contrib_and_sbx_run(tmp_path):
    run_page("sb3-contrib", tmp_path)
