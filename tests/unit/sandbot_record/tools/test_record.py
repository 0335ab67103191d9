from sandbot_record.tools import record


def test_a_slip_behind_ros_args_leaves_no_bag(tmp_path, capfd):
    assert record.main(["/leg_states", "--out", str(tmp_path / "bag"), "--ros-args", "--bogus"]) == 2
    assert "--bogus" in capfd.readouterr().err
    assert not list(tmp_path.iterdir())
