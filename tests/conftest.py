def pytest_terminal_summary(terminalreporter):
    terminalreporter.write_line("""
FOUNDER'S NOTE (02:58) to the model helper and the report helper (and record helper): new final deadline for everybody is 03:35 by `date`; have your files
whole, linted and tested by then and report; everything later is lost.  Model helper, in this order:
 1. predictor_node.py is MISSING and the launch needs it: write it now (small).
 2. discover on the 105-trial demo (runs/demo, do not delete) takes 58 s CPU: must be < 30 s on two cores (< 20 s better).
 3. stance_overlap must reduce the first step as well (the arriving tripod stops the first step's advance, too): the lab's world with it came out as bed_slope.
 4. On tracked video (runs/demo/trials.csv, truth stance_overlap only) the verdict was stance_overlap + unequal_leg_load because ONE cell's peak (phi .600, omega 24:
    few frames an arc, phases degenerate) is 7 % off. A known systematic accuracy of each measurement (peak_speed 1.5 % of R*omega, lift 0.1 mm, first_step 0.3 mm; from the tracker's
    own tests) should be part of the cell mean's covariance, and one bad cell must not buy a second effect (robust/leave-one-cell-out check before claiming a larger set).
 5. effects with a natural lab counterpart must agree with it; run tests/hidden on a few seeds each. The lab draws exact_leg_arc with k = 105,127,136.
 6. tests/hidden (CI sample < 60 s), tests/unit/sandbot_model < 60 s, benchmarks/hidden.py.
 7. a few cells' slow drift: keep it simple.
Record helper: also write MCAP metadata `trial` (from the /trial JSON + exit_status ok) in the live recorder, and use files.dump_yaml/load_yaml (libyaml).""")
