import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from sandbot_bringup import node_table
from sandbot_common.errors import InputError

SWITCH = {"default": "true", "choices": ["true", "false"], "doc": "x"}


def table(tmp_path, entries, arguments=None):
    path = tmp_path / "nodes.yaml"
    path.write_text(yaml.safe_dump({"arguments": {"lab": SWITCH, **(arguments or {})}, "nodes": entries}))
    return node_table.read_table(path)


def entry(name, **more):
    return {"package": "pack", "executable": "exe", "name": name, **more}


def names(selected):
    return [one.name for one in selected]


def test_the_project_s_own_table_starts_lab_or_hardware_and_never_both():
    own = node_table.read_table(node_table.table_path())
    with_lab, without = names(node_table.selected(own, {})), names(node_table.selected(own, {"lab": "false"}))
    assert {"clock", "bed", "tracker", "predictor", "lab"} <= set(with_lab)
    assert "lab" not in without
    assert {"clock", "bed", "tracker", "predictor"} <= set(without)
    assert "console" not in with_lab
    assert "console" in names(node_table.selected(own, {"console": "true"}))


def test_every_node_of_the_own_table_is_an_executable_of_the_workspace():
    from importlib.metadata import entry_points

    scripts = {(one.dist.name.replace("-", "_"), one.name) for one in entry_points(group="console_scripts")}
    for node in node_table.read_table(node_table.table_path()).nodes:
        assert (node.package, node.executable) in scripts


def test_wanted_and_only_if(tmp_path):
    entries = [
        entry("a"),
        entry("b", wanted="lab"),
        entry("c", wanted="hardware"),
        entry("d", wanted="lab", only_if="extra"),
    ]
    made = table(tmp_path, entries, {"extra": {**SWITCH, "default": "false"}})
    assert names(node_table.selected(made, {})) == ["a", "b"]
    assert names(node_table.selected(made, {"extra": "true"})) == ["a", "b", "d"]
    assert names(node_table.selected(made, {"lab": "false"})) == ["a", "c"]


def test_arguments_are_put_into_parameters_with_their_type(tmp_path):
    parameters = {"seed": "${seed}", "world": "${world}", "label": "plain"}
    arguments = {"seed": {"default": 7, "doc": "x"}, "world": {"default": "", "doc": "x"}}
    made = table(tmp_path, [entry("a", parameters=parameters)], arguments)
    (node,) = node_table.selected(made, {"world": "w.yaml"})
    assert node.parameters == {"seed": 7, "world": "w.yaml", "label": "plain"}
    (node,) = node_table.selected(made, {"seed": "8", "world": "9"})
    assert node.parameters == {"seed": 8, "world": "9", "label": "plain"}
    with pytest.raises(InputError, match=r"launch argument seed: '1\.5' is not a whole number"):
        node_table.selected(made, {"seed": "1.5"})


def test_config_is_the_folder_of_the_table_also_in_an_argument_s_value(tmp_path):
    arguments = {"cameras": {"default": "${config}/cameras.yaml", "doc": "x"}}
    made = table(tmp_path, [entry("a", parameters={"x": "${cameras}", "y": "${config}/b"})], arguments)
    assert node_table.selected(made, {})[0].parameters == {"x": f"{tmp_path}/cameras.yaml", "y": f"{tmp_path}/b"}
    assert node_table.selected(made, {"cameras": "c.yaml"})[0].parameters["x"] == "c.yaml"


def test_any_parameter_of_any_node_can_be_set(tmp_path):
    made = table(tmp_path, [entry("a", parameters={"x": 1}), entry("b")])
    a, b = node_table.selected(made, {"a.x": "2", "b.gains.p": "[1.0, 2.0]", "a.name": "7up"})
    assert a.parameters == {"x": 2, "name": "7up"}
    assert b.parameters == {"gains.p": [1.0, 2.0]}
    # The table itself is as it was.
    assert node_table.selected(made, {})[0].parameters == {"x": 1}


def test_parameters_given_are_of_the_types_the_node_declares():
    own = node_table.read_table(node_table.table_path())
    given = {"bed.pulse_off_s": "1", "dorsal_camera.video": "2", "clock.use_sim_time": "true"}
    made = {node.name: node.parameters for node in node_table.selected(own, given | {"lab": "false"})}
    assert repr(made["bed"]["pulse_off_s"]) == "1.0"  # ROS takes an integer for no float
    assert made["dorsal_camera"]["video"] == "2"
    assert made["clock"]["use_sim_time"] is True
    for node in own.nodes:
        with pytest.raises(InputError, match=f"launch arguments of {node.name}: unknown key 'nope'"):
            node_table.selected(own, {f"{node.name}.nope": "1"})


@pytest.mark.parametrize(
    ("typed", "needed"),
    [
        ("leg_driver:=serial", "lab:=false"),
        ("bed_device:=/dev/ttyUSB3", "lab:=false bed_driver:=serial"),
        ("bed_device:=/dev/ttyUSB3 lab:=false", "bed_driver:=serial"),
        ("dorsal_video:=top.avi lab:=false camera_driver:=serial", "camera_driver:=video"),
        ("world:=w.yaml lab:=false", "lab:=true"),
        ("lab.seed:=3 lab:=false", "lab:=true"),
        ("dorsal_camera.playback:=0.5", "lab:=false"),
        ("console.port:=8061", "console:=true"),
        ("scene.rate_hz:=5.0", "scene:=true"),
    ],
)
def test_what_no_node_would_use_is_refused_with_what_it_takes(typed, needed):
    own, given = node_table.read_table(node_table.table_path()), node_table.parse_arguments(typed.split())
    with pytest.raises(InputError) as refused:
        node_table.selected(own, given)
    name = typed.partition(":=")[0]
    assert str(refused.value) == f"launch argument {name}: no started node uses it; it needs {needed}"
    # Control: what is said helps, and a default changes nothing, which the real launch gives for all.
    defaults = {one.name: one.default_text for one in own.arguments.values()}
    assert node_table.selected(own, defaults | given | node_table.parse_arguments(needed.split()))


@pytest.mark.parametrize("space", ["robot1", "/robot1", "lab/robot_1"])
def test_a_namespace_is_given_to_every_node(tmp_path, space):
    arguments = {"namespace": {"default": "", "doc": "x"}}
    made = node_table.selected(table(tmp_path, [entry("a"), entry("b")], arguments), {"namespace": space})
    assert [one.ros_arguments()[3:] for one in made] == [["-r", f"__ns:=/{space.removeprefix('/')}"]] * 2


@pytest.mark.parametrize("space", ["1robot", "robot 1", "/", "a//b", "a/", "ro-bot"])
def test_what_is_no_namespace_is_refused(tmp_path, space):
    arguments = {"namespace": {"default": "", "doc": "x"}}
    with pytest.raises(InputError, match="is not a ROS namespace such as robot1"):
        node_table.selected(table(tmp_path, [entry("a")], arguments), {"namespace": space})


def test_ros_arguments_carry_name_and_parameters():
    node = node_table.NodeEntry("p", "e", "n", parameters={"a": 1, "b": "1", "c": True, "d": [0.5, 2.0], "e": "x y"})
    assert node.ros_arguments() == [
        "--ros-args",
        "-r",
        "__node:=n",
        "-p",
        "a:=1",
        "-p",
        'b:="1"',
        "-p",
        "c:=true",
        "-p",
        "d:=[0.5, 2.0]",
        "-p",
        'e:="x y"',
    ]


scalars = st.one_of(st.booleans(), st.integers(), st.floats(allow_nan=False), st.text(max_size=20))


@given(st.one_of(scalars, st.lists(st.integers(), max_size=4), st.lists(st.text(max_size=5), max_size=4)))
def test_a_parameter_on_the_command_line_reads_back_as_it_was(value):
    *_, last = node_table.NodeEntry("p", "e", "n", parameters={"x": value}).ros_arguments()
    assert "\n" not in last
    assert yaml.safe_load(last.removeprefix("x:=")) == value


@pytest.mark.parametrize(
    ("word", "complaint"), [("lab=true", "malformed"), (":=true", "malformed"), ("lab", "malformed")]
)
def test_malformed_launch_arguments_are_refused(word, complaint):
    with pytest.raises(InputError, match=complaint):
        node_table.parse_arguments([word])


def test_launch_arguments_are_read():
    assert node_table.parse_arguments(["lab:=true", "a.b:=x:=y"]) == {"lab": "true", "a.b": "x:=y"}


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"lba": "true"}, "unknown launch argument 'lba'"),
        ({"lab": "yes"}, "lab: 'yes' is not one of true, false"),
        ({"nope.x": "1"}, "unknown launch argument 'nope.x'"),
        ({"a.": "1"}, "unknown launch argument 'a.'"),
    ],
)
def test_unknown_or_wrong_launch_arguments_are_refused(tmp_path, given, complaint):
    with pytest.raises(InputError, match=complaint):
        node_table.selected(table(tmp_path, [entry("a")]), given)


@pytest.mark.parametrize(
    ("entries", "complaint"),
    [
        ([], "nodes: expected a list of nodes"),
        ([{"package": "p", "executable": "e"}], r"nodes\[0\]: missing key 'name'"),
        ([entry("a", want="lab")], r"nodes\[0\]: unknown key 'want', did you mean 'wanted'"),
        ([entry("a", wanted="always")], "'always' is not one of lab, hardware, both"),
        ([entry("a"), entry("a")], r"nodes\[1\]: name: 'a' is taken"),
        ([entry("a", only_if="nope")], "only_if: 'nope' is not a launch argument"),
        ([entry("a", parameters={"x": "${nope}"})], "no launch argument 'nope'"),
        ([entry("a", parameters={"x": {"y": 1}})], "is not a number, text"),
        ([entry("a", parameters={1: 1})], "1 is not a name"),
        ([entry("a", parameters=[1])], "parameters"),
    ],
)
def test_bad_tables_are_refused_with_file_and_entry(tmp_path, entries, complaint):
    with pytest.raises(InputError, match=complaint) as error:
        table(tmp_path, entries)
    assert "nodes.yaml" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({"nodes": [entry("a")]}, "'lab' with the choices true and false is needed"),
        ({"arguments": {"lab": {**SWITCH, "default": "yes"}}, "nodes": [entry("a")]}, "default: 'yes' is not one of"),
        ({"arguments": [1], "nodes": [entry("a")]}, "arguments: expected a mapping"),
        ({"arguments": {"lab": SWITCH}, "nodes": [entry("a")], "extra": 1}, "unknown key 'extra'"),
    ],
)
def test_bad_arguments_sections_are_refused(tmp_path, content, complaint):
    path = tmp_path / "nodes.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=complaint):
        node_table.read_table(path)
