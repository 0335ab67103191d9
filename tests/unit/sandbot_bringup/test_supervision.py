from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup.supervision import Sign, Supervisor
from sandbot_common.lease import Lease

CLOCK, TRACKER = Sign("clock", "/leg_setpoints", 0.5), Sign("tracker", "/speed", 2.0)


def test_who_falls_silent_is_named_and_nobody_else():
    supervisor = Supervisor()
    supervisor.watch(CLOCK, TRACKER, now_s=10.0)
    for t_s in (10.1, 10.4, 10.8):
        supervisor.heard("clock", "/leg_setpoints", t_s)
        assert supervisor.silent(t_s + 0.4) == ""
    assert supervisor.silent(11.4) == "clock is silent: nothing from it on /leg_setpoints for 0.5 s"
    supervisor.heard("clock", "/diagnostics", 11.4)  # a sign of another kind is not this one
    assert supervisor.silent(11.4).startswith("clock")
    supervisor.watch(TRACKER, now_s=11.4)
    assert supervisor.silent(11.9) == ""
    assert supervisor.silent(12.1).startswith("tracker")  # watched since 10.0, not since the last watch
    supervisor.pardon(12.1)
    assert supervisor.silent(14.0) == ""


@given(
    st.floats(0.01, 10.0), st.lists(st.floats(0.0, 100.0), min_size=1, max_size=20).map(sorted), st.floats(0.0, 50.0)
)
def test_a_lease_lasts_its_limit_from_the_last_renewal_and_never_before_the_first(limit_s, renewals, later_s):
    lease = Lease(limit_s)
    assert lease.late(renewals[0])
    for now_s in renewals:
        lease.renew(now_s)
        assert not lease.late(now_s)
    assert lease.late(renewals[-1] + later_s) is (renewals[-1] + later_s - renewals[-1] > limit_s)


def test_time_that_is_not_a_number_is_late():
    lease = Lease(1.0, 0.0)
    assert lease.late(float("nan"))
