from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.streak import ALIKE, Streak

LATE = "clock: no set-point for 0.0{} s at t = {}.5 s; its bag is kept in c/.partial/phi0.6050_w08.000_r0{}"
DEAF = "the bed was not prepared: no height for 0.5 s"


def alike(streak, reasons):
    return [streak.failed(reason) for reason in reasons]


def test_who_fails_again_and_again_of_one_cause_is_told_so():
    *before, last = alike(Streak(), [LATE.format(n, n, n) for n in range(ALIKE)])
    assert not any(before)
    assert last == f"{ALIKE} trials in a row failed alike, the last: {LATE.format(4, 4, 4)}"


def test_a_trial_that_goes_well_or_a_hand_ends_it():
    streak = Streak()
    alike(streak, [DEAF] * (ALIKE - 1))
    streak.end()
    assert not any(alike(streak, [DEAF] * (ALIKE - 1)))
    assert streak.failed(DEAF)


@given(st.lists(st.sampled_from([DEAF, LATE.format(1, 2, 3), "the tracker is frozen"]), max_size=30))
def test_it_speaks_exactly_where_so_many_in_a_row_are_one(reasons):
    for index, said in enumerate(alike(Streak(), reasons)):
        run = reasons[index + 1 - ALIKE : index + 1] if index + 1 >= ALIKE else []
        assert bool(said) == (len(set(run)) == 1)
