import pytest

from sandbot_common.errors import InputError
from sandbot_record.tools import record


@pytest.mark.parametrize(
    ("slip", "said"), [("--bogus", "--bogus"), ("-p duration:=5.0", "-p duration: record is set by")]
)
def test_a_slip_behind_ros_args_leaves_no_bag(tmp_path, domain, capfd, slip, said):
    assert record.main(["/leg_states", "--out", str(tmp_path / "bag"), "--ros-args", *slip.split()]) == 2
    assert said in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


def checked(words):
    record._check(record._parser().parse_args([*words.split(), "--out", "bag"]))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("/leg_states --exclude /leg", "--exclude: of topics that are named none is left out"),
        ("--all --images none --pause-images", "--pause-images: --images none"),
        ("--all --duration 0", "--duration 0: more than 0 is needed; leave it out for no limit"),
        ("--all --duration nan", "--duration nan: more than 0"),
        ("--all --max-size 0", "--max-size 0: more than 0"),
        ("--all --max-duration 0", "--max-duration 0: more than 0"),
        ("--all --min-free -1", "--min-free: -1.0 is not a number from 0 up"),
        ("--all --max-size 1e-7", "--max-size: 1e-07 MiB is less than a byte"),
        ("--all --attach a/x.yaml b/x.yaml", "--attach: two files are named x.yaml"),
    ],
)
def test_what_would_be_ignored_is_refused(words, said):
    with pytest.raises(InputError, match=said):
        checked(words)


@pytest.mark.parametrize(
    "words",
    [
        "--all --exclude /leg --min-free 0",
        "--all --duration 1e-3 --max-duration 5",
        "/a --regex /leg --exclude states --max-size 1e-6",
        "--all --images video --pause-images --attach a/x.yaml b/y.yaml",
    ],
)
def test_what_is_obeyed_is_taken(words):
    checked(words)
