from hypothesis import given, settings
from hypothesis import strategies as st

from style_core.stream.stamp_policy import NANOSECONDS, StampPolicy

S = NANOSECONDS
MS = S // 1000


def policy(**changes):
    return StampPolicy(**{'max_age': S // 2, 'max_gap': S, 'reorder_window': 100 * MS, **changes})


def test_zero_means_the_arrival_time():
    verdict = policy().judge(0, 5 * S)
    assert (verdict.stamp, verdict.reason, verdict.reset) == (5 * S, 'zero', False)


def test_stale_and_future_stamps_are_dropped_by_name():
    judge = policy().judge
    assert judge(10 * S - 600 * MS, 10 * S).reason == 'stale'
    assert judge(10 * S + 600 * MS, 10 * S).reason == 'future'
    assert judge(10 * S - 400 * MS, 10 * S).stamp == 10 * S - 400 * MS


def test_without_an_age_limit_old_recordings_pass():
    assert policy(max_age=0).judge(3 * S, 1_000_000 * S).stamp == 3 * S


def test_slightly_late_stamps_pass_for_the_assembler_to_judge():
    judge = policy(max_age=0).judge
    judge(10 * S, 0)
    assert judge(10 * S - 50 * MS, 0).stamp == 10 * S - 50 * MS
    assert not judge(10 * S + 10 * MS, 0).reset


def test_one_broken_stamp_changes_nothing():
    for wild in (S, 500 * S):
        judge = policy(max_age=0).judge
        judge(10 * S, 0)
        assert judge(wild, 0).reason == 'jump'
        verdict = judge(10 * S + 10 * MS, 0)
        assert verdict.stamp == 10 * S + 10 * MS and not verdict.reset


def test_two_agreeing_stamps_after_a_jump_reset_once():
    for start in (2 * S, 500 * S):
        judge = policy(max_age=0).judge
        judge(10 * S, 0)
        assert judge(start, 0).stamp is None
        assert judge(start + 10 * MS, 0).reset
        assert not judge(start + 20 * MS, 0).reset


def test_a_pause_resets_at_once():
    judge = policy().judge
    judge(10 * S, 10 * S + 2 * MS)
    verdict = judge(15 * S, 15 * S + 30 * MS)
    assert verdict.stamp == 15 * S and verdict.reset


def test_a_repeated_wild_stamp_does_not_confirm_itself():
    judge = policy(max_age=0).judge
    judge(10 * S, 0)
    assert all(judge(S, 0).reason == 'jump' for _ in range(5))


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(-2**62, 2**62), max_size=40))
def test_any_stamps_are_judged_and_without_a_pause_only_confirmed_jumps_reset(stamps):
    judge = policy(max_age=0).judge
    dropped = False
    for stamp in stamps:
        verdict = judge(stamp, 7 * S)
        assert verdict.stamp in (None, stamp, 7 * S)
        assert not verdict.reset or dropped
        dropped = dropped or verdict.reason == 'jump'
