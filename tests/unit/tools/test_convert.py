import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import Float64, Header, String
from std_srvs.srv import SetBool, Trigger

from ros2cli_fallback import convert
from ros2cli_fallback.cover import Failure

# PyYAML, and so the real ros2 too, does not bring every control character back.
printable = st.characters(exclude_categories=("C", "Z"))


def joint_state():
    header = Header(stamp=Time(sec=1, nanosec=2), frame_id="")
    return JointState(header=header, name=["a", "b"], position=[0.5, 1.0], velocity=[], effort=[])


def test_yaml_is_what_the_real_ros2_prints():
    assert convert.to_yaml(joint_state()) == (
        "header:\n  stamp:\n    sec: 1\n    nanosec: 2\n  frame_id: ''\n"
        "name:\n- a\n- b\nposition:\n- 0.5\n- 1.0\nvelocity: []\neffort: []\n"
    )


def test_csv_is_what_the_real_ros2_prints():
    assert convert.to_csv(joint_state()) == "1,2,,a,b,0.5,1.0"


def test_an_octet_is_printed_as_its_character():
    status = DiagnosticStatus(level=bytes([0]), name="bed", values=[KeyValue(key="stage", value="ready")])
    assert convert.to_yaml(status).startswith('level: "\\0"\nname: bed\n')


@pytest.mark.parametrize("length", [127, 128])
def test_what_fits_is_not_truncated(length):
    assert len(convert.to_plain(Image(data=bytes(length)), truncate=128)["data"]) == length


def test_long_arrays_and_texts_are_truncated():
    data = convert.to_plain(Image(data=bytes(129)), truncate=128)["data"]
    assert data == [0] * 128 + ["..."]
    assert convert.to_plain(String(data="x" * 5), truncate=4) == {"data": "xxxx..."}


def test_arrays_and_texts_can_be_left_out():
    plain = convert.to_plain(joint_state(), no_arr=True, no_str=True)
    assert plain["position"] == "<sequence type: double, length: 2>"
    assert plain["header"]["frame_id"] == "<string length: <0>>"
    covariance = convert.to_plain(TwistWithCovarianceStamped(), no_arr=True)["twist"]["covariance"]
    assert covariance == "<array type: double[36]>"


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), max_size=6), st.text(printable, max_size=8))
def test_yaml_round_trip(position, frame):
    message = JointState(header=Header(frame_id=frame), position=position)
    plain = yaml.safe_load(convert.to_yaml(message))
    assert convert.fill(JointState(), plain) == message


def test_field_follows_a_dotted_path():
    message = TwistWithCovarianceStamped()
    message.twist.twist.linear.x = 0.25
    assert convert.field(message, "twist.twist.linear.x") == 0.25
    with pytest.raises(Failure, match=r"Invalid field 'twist\.speed'"):
        convert.field(message, "twist.speed")
    with pytest.raises(Failure, match=r"Invalid field"):
        convert.field(message, "twist.twist.linear.x.y")


def test_fill_takes_an_integer_for_a_float_and_refuses_nonsense():
    assert convert.fill(Float64(), {"data": 1}).data == 1.0
    with pytest.raises(Failure, match=r"Failed to populate field: .* no field 'date'"):
        convert.fill(Float64(), {"date": 1.0})
    with pytest.raises(Failure, match=r"Failed to populate field: data"):
        convert.fill(SetBool.Request(), {"data": "yes"})
    with pytest.raises(Failure, match=r"expected a mapping"):
        convert.fill(SetBool.Request(), [True])


def test_interface_takes_long_and_short_names():
    assert convert.interface("std_msgs/msg/Float64", "msg") is Float64
    assert convert.interface("std_srvs/Trigger", "srv") is Trigger


@pytest.mark.parametrize(
    "name", ["", "Float64", "std_msgs/srv/Float64", "std_msgs/msg/Nope", "nope/msg/Nope", "os/../path", "a/b/c/d"]
)
def test_interface_refuses_other_names(name):
    with pytest.raises(Failure, match="The passed message type is invalid"):
        convert.interface(name, "msg")


def test_numpy_values_become_plain():
    assert convert.to_plain([np.float64(0.5), np.int64(3)]) == [0.5, 3]
