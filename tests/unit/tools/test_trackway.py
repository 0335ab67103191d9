"""The command `trackway`: its verbs are the executables, from any folder and with nothing sourced."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import install_ros2_fallback as installer
from sandbot_common.errors import InputError
from trackway_command import main
from trackway_command.verbs import FLAGS, MANY, VERBS, then, usage

BARE = {"PATH": "/usr/bin:/bin", "HOME": "/tmp"}
TRACKWAY = installer.TRACKWAY
NO_FORWARD = {"demo", "doctor", "live"}
NEXT, REPORT = ("discover", "explore"), "--html report.html"


def trackway(*arguments, **options):
    return subprocess.run(
        [TRACKWAY, *arguments], env=BARE, text=True, capture_output=True, timeout=120, check=False, **options
    )


def test_it_is_put_beside_python_and_again_changes_nothing(tmp_path):
    for _ in range(2):
        installer.install_trackway(tmp_path)
        assert (tmp_path / "trackway").resolve() == TRACKWAY
        assert not (tmp_path / "trackway").readlink().is_absolute()


@pytest.mark.parametrize("name", sorted(VERBS.keys() - NO_FORWARD))
def test_a_verb_is_the_executable_of_its_name(name):
    path, *arguments = main.command(name, ["--flag", "x"], {})
    assert os.access(path, os.X_OK)
    assert Path(path).name == name
    assert Path(path).parent.name == VERBS[name].package
    assert arguments == ["--flag", "x"]


def test_every_executable_of_the_workspace_has_a_line_or_is_forwarded_to():
    others = {name for package in main.PACKAGES for name in main.executables(package)} - VERBS.keys()
    told = usage(sorted(others))
    assert {"clock", "bed", "tracker", "camera", "predictor"} <= others
    for name in (*VERBS, *others):
        assert name in told
    assert max(map(len, told.splitlines())) <= 80
    assert "sandbot_model" not in told


def test_the_shells_pipe_is_a_file_of_the_verb(tmp_path):
    row = r"phi,omega_rad_s,speed_m_s\n0.6,12,0.1\n"
    table = subprocess.run(
        ["bash", "-c", f"{TRACKWAY} table <(printf '{row}')"],
        env=BARE, text=True, capture_output=True, timeout=120, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert "no such file" not in table.stderr


def test_an_error_is_of_its_verb(capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["trackway"])
    assert main.main(["doctor", "--patience", "x"]) == 2
    assert capsys.readouterr().err.startswith("doctor: error: argument --patience")


def test_demo_runs_the_script_and_live_the_launch_file():
    assert main.command("demo", [], {})[1:] == [str(main.TOOLS / "demo.sh"), *main.DEMO]
    assert main.command("demo", ["mine"], {})[2:] == ["mine", main.DEMO[1]]
    assert main.command("demo", ["mine", "7"], {})[2:] == ["mine", "7"]
    with pytest.raises(InputError, match="no option --sed; known: --help"):
        main.command("demo", ["--sed", "7"], {})
    with pytest.raises(SystemExit, match="0"):
        main.command("demo", ["--help"], {})
    assert (main.TOOLS / "demo.sh").is_file()
    assert main.command("live", ["console:=true"], {})[-2:] == ["trackway.launch.py", "console:=true"]


def test_a_verb_that_is_none_is_answered_with_the_one_that_may_be_meant():
    with pytest.raises(InputError, match="no verb 'compar', did you mean 'compare'"):
        main.command("compar", [], {})


OWN = ["--effects-from", "own.py"]
TYPED = ["--effect", "x: strength: k*(1 + a); a [1] in -5..5"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("compare a.csv", ["discover a.csv", "explore a.csv"]),
        ("compare --verbose a.csv b.csv", ["discover a.csv b.csv", "explore a.csv b.csv"]),
        ("compare a.csv --model full", ["discover a.csv --model full", "explore a.csv"]),
        ("compare a.csv --hold x=1 --selection s.yaml", ["discover a.csv", "explore a.csv --selection s.yaml"]),
        (["compare", "a.csv", *OWN, *TYPED], [f"{verb} a.csv {shlex.join(OWN + TYPED)}" for verb in NEXT]),
        ("discover a.csv --robot=r.yaml", ["explore a.csv --robot r.yaml", f"discover a.csv --robot=r.yaml {REPORT}"]),
        ("discover a.csv --max-effects 1", ["explore a.csv", f"discover a.csv --max-effects 1 {REPORT}"]),
        ("discover a.csv --html d.html", ["explore a.csv"]),
        ("discover --next n.csv a.csv --verbose", ["explore a.csv", f"discover a.csv --verbose {REPORT}"]),
        ("discover /dev/stdin", []),
        ("discover none.csv", []),
        ("campaign a.csv --out run", ["compare run", "discover run"]),
        ("campaign a.csv --out=run --bed-drift 0.1", ["compare run", "discover run --bed-drift 0.1"]),
        ("campaign a.csv --out c1 --dry-run", []),
        ("campaign a.csv", []),
        ("record -a -o run", ["info run", "replay run"]),
        ("replay run --topics /a /b", ["info run"]),
        (["table", "my trials"], ["compare 'my trials'"]),
        ("table --rate 8 run", ["compare run"]),
        ("table --robot a.csv", []),
        ("effects leg_slip", ["effects --quantities"]),
        ("effects --quantities", []),
    ],
)
def test_what_is_next_works_as_printed(arguments, told, tmp_path, monkeypatch):
    """On all that was given, with the options that both take, quoted; nothing that isn't there, or was just done."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "b.csv", "run", "my trials"):
        (tmp_path / name).mkdir()
    name, *words = arguments if isinstance(arguments, list) else arguments.split()
    assert then(VERBS[name], words) == [f"trackway {line}" for line in told]


def usage_of(name):
    """The usage of a verb in docs/lookup/commands.md, without metavariables in quotes."""
    text = (main.TOOLS.parent / "docs/lookup/commands.md").read_text(encoding="utf-8")
    return re.sub(r"'[^']*'", "X", re.search(rf"^usage: {name} (.*?)\n\n", text, re.DOTALL | re.MULTILINE)[1])


def test_what_is_next_is_a_command_that_takes_these_options():
    for verb in VERBS.values():
        for line in verb.then:
            assert line.split()[0] == "trackway"
            assert line.split()[1] in VERBS
        for option in verb.takes:
            assert f"[{option} " in usage_of(verb.name)


@pytest.mark.parametrize("name", [verb.name for verb in VERBS.values() if verb.then and verb.package])
def test_options_have_as_many_values_as_is_assumed(name):
    of_help = re.findall(r"(--[a-z-]+)( [^][|-]+)?( ?\[\w[^]]*])?", usage_of(name))
    assert {option for option, *values in of_help if not any(values)} <= {*FLAGS}
    assert {option for option, *values in of_help if any(values)}.isdisjoint(FLAGS)
    assert {option for option, value, more in of_help if value and more} == {*MANY} & {option for option, *_ in of_help}


@pytest.mark.slow
def test_from_any_folder_with_nothing_sourced(tmp_path):
    (tmp_path / "t.csv").write_text("phi,omega_rad_s,speed_m_s\n0.633,16,0.203\n0.633,16,0.198\n")
    done = trackway("compare", "t.csv", cwd=tmp_path)
    assert (done.returncode, done.stdout.split("\n")[0][:12]) == (0, "simple model")
    assert done.stderr == "next: trackway discover t.csv\n      trackway explore t.csv\n"
    failed = trackway("compare", "none.csv", cwd=tmp_path)
    assert (failed.returncode, failed.stdout) == (2, "")
    assert failed.stderr == "compare: error: none.csv: no such file or folder\n"
    helped = trackway("compare", "--help", cwd=tmp_path)
    assert helped.stdout.startswith("usage: compare ")
    assert helped.stderr == ""


def test_alone_it_lists_its_verbs_and_a_strange_one_is_one_line(tmp_path):
    assert trackway(cwd=tmp_path).stdout.startswith("usage: trackway VERB")
    strange = trackway("comapre", cwd=tmp_path)
    assert strange.returncode == 2
    assert strange.stderr == "trackway: error: no verb 'comapre', did you mean 'compare'?\n"


RUN = [sys.executable, str(TRACKWAY.with_name("ros2")), "run", "sandbot_model"]


def struck():
    """Ctrl-C before anybody can answer it: held back, as it is held while a command imports."""
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("verb", ["compare", "discover", "explore", "atlas", "effects"])
@pytest.mark.parametrize("how", [[str(TRACKWAY)], RUN], ids=["trackway", "ros2 run"])
def test_ctrl_c_while_all_is_being_imported_is_one_line_and_130(how, verb, tmp_path):
    done = subprocess.run(
        [*how, verb, "t.csv", "--json", "out.json"], preexec_fn=struck, cwd=tmp_path, text=True, capture_output=True,
        timeout=120, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (130, "")
    (line,) = done.stderr.splitlines()
    assert line.endswith(": interrupted; what was finished is kept")
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_ours_is_never_started_with_ctrl_c_held_back(tmp_path):
    asks = "import signal, sys; sys.exit(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
    assert main._run([sys.executable, "-c", asks], ours=True) == 1
    assert main._run([sys.executable, "-c", asks], ours=False) == 0


@pytest.mark.parametrize("group", [False, True], ids=["sent to it alone", "sent to all, as by a terminal"])
def test_an_interrupt_that_a_process_sends_ends_the_verb_too(group):
    """A shell's `kill -INT $!` and a supervisor know only the process of `trackway`."""
    waits = "import signal, sys\ntry: print('here', flush=True), signal.pause()\nexcept KeyboardInterrupt: sys.exit(7)"
    verb = [sys.executable, "-c", waits]
    opens = f"import sys; from trackway_command.main import _run; sys.exit(_run({verb!r}, ours=False))"
    trackway_of = [sys.executable, "-c", opens]
    with subprocess.Popen(
        trackway_of,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as process:
        assert process.stdout.readline() == "here\n"
        (os.killpg if group else os.kill)(process.pid, signal.SIGINT)
        assert process.wait(timeout=60) == 7


def test_version_and_help(capsys):
    assert main._main(["--version"]) == 0
    assert re.fullmatch(r"trackway \d+\.\d+\.\d+, commit [0-9a-f]{7,}(-dirty)?\n", capsys.readouterr().out)
    assert main._main(["help"]) == 0
    assert capsys.readouterr().out.startswith("usage: trackway VERB")


def test_a_verb_that_a_signal_ends_says_so_as_a_shell_does():
    assert main._run(["sh", "-c", "kill -TERM $$"], ours=False) == 128 + signal.SIGTERM


@pytest.fixture(autouse=True)
def _mask():
    """Of this process, whose verbs are run in it by some of these tests."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    for number, handler in handlers.items():
        signal.signal(number, handler)
