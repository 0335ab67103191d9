"""The catalogue: effects of the project and of users' files, and what is refused as one."""

import pickle
from importlib.metadata import EntryPoint

import pytest

from sandbot_common.errors import InputError
from sandbot_model.physics import catalogue as catalogue_module
from sandbot_model.physics.catalogue import catalogue, describe, effects_in
from sandbot_model.physics.effects import CATALOGUE
from sandbot_model.physics.walking import Inputs, Walker

OWN = '''
from sandbot_model.physics.effect import Effect, Parameter


class Boost(Effect):
    """Ground hardens with use."""

    identifier = "boost"
    stage = "strength"
    formula = "k -> k (1 + a)"
    source = "me"
    seen_in = "v"
    parameters = (Parameter("a", "1", 0.0, 0.5, 0.1, "gain"),)

    def apply(self, chain, p):
        chain.k = chain.k * (1 + p["a"])
'''


def test_all_effects_are_described():
    assert len(describe(catalogue())) == len(CATALOGUE)
    assert list(catalogue()) == [effect.identifier for effect in CATALOGUE]


def test_a_file_adds_an_effect(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(OWN)
    effects = catalogue([path])
    boosted = Walker((effects["boost"],)).predict(Inputs(200.0, 8.0, 0.4), [{"a": 0.1}])
    assert float(boosted.depth_m) == pytest.approx(float(Walker().predict(Inputs(220.0, 8.0, 0.4)).depth_m))


def test_what_a_file_prints_is_no_part_of_the_answer(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(f'print("hello")\n{OWN}')
    effects_in(tmp_path / "mine.py")
    assert capsys.readouterr() == ("", "hello\n")


@pytest.mark.parametrize(
    "where",
    [
        "sandbot_model import Chain, Effect, Parameter, Values",
        "sandbot_model.chain import Chain, Effect, Parameter, Values",
        "sandbot_model.physics.effect import Chain, Effect, Parameter, Values",
    ],
)
def test_a_file_of_any_release_adds_an_effect(tmp_path, where):
    path = tmp_path / "mine.py"
    path.write_text(OWN.replace("sandbot_model.physics.effect import Effect, Parameter", where))
    assert [one.identifier for one in effects_in(path)] == ["boost"]


def test_files_of_one_name_and_names_with_dots_reach_workers(tmp_path):
    """Workers find an effect's class by its module: two files of one name took each other's place, and all hung."""
    paths = [tmp_path / "a" / "mine.py", tmp_path / "b" / "mine.py", tmp_path / "v1.2.py"]
    for number, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True)
        path.write_text(OWN.replace('"boost"', f'"boost_{number}"'))
    effects = catalogue(paths)
    for number in range(3):
        assert pickle.loads(pickle.dumps(effects[f"boost_{number}"])).identifier == f"boost_{number}"


@pytest.mark.parametrize("kept", ["lambda c: c", "__import__('threading').Lock()"])
def test_an_effect_that_no_worker_can_receive_is_refused(tmp_path, kept):
    path = tmp_path / "mine.py"
    path.write_text(f"{OWN}\n    def __init__(self):\n        self.kept = {kept}\n")
    with pytest.raises(InputError, match=r"Boost: can't be sent to worker processes: (Attribute|Type)Error"):
        effects_in(path)
    path.write_text(f"{OWN}\n    def __init__(self):\n        self.kept = abs\n")
    assert [one.identifier for one in effects_in(path)] == ["boost"]


def test_an_effect_that_vanishes_at_its_neutral_value_is_read(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(OWN.replace('"gain")', '"gain", neutral=0.0)'))
    assert [one.parameters[0].neutral for one in effects_in(path)] == [0.0]


def test_an_import_that_never_was_is_refused(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(OWN.replace("sandbot_model.physics.effect", "sandbot_model.effects_of_mine"))
    with pytest.raises(InputError, match="ModuleNotFoundError"):
        effects_in(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1", "no subclass"),
        ("def (", "SyntaxError"),
        ("1 / 0", "ZeroDivisionError"),
        (OWN.replace('"strength"', '"muscle"'), "stage 'muscle' is not one of"),
        (OWN.replace('    seen_in = "v"\n', ""), "has no seen_in"),
        (
            OWN.replace('    seen_in = "v"\n', '    seen_in, control = "v", 3\n'),
            "control is 3, it may be an experiment",
        ),
        (OWN.replace('"boost"', '"leg_slip"'), "already"),
        (OWN.replace('"gain"),)', '"gain"))'), "parameters is not a tuple; is a comma missing"),
        (
            OWN.replace('Parameter("a", "1", 0.0, 0.5, 0.1, "gain")', '"a"'),
            "parameters holds 'a', expected a Parameter",
        ),
        *(
            (OWN.replace("0.0, 0.5, 0.1", numbers), f"a: from {words} is not a range, low < high is needed")
            for numbers, words in {
                "0.1, 0.1, 0.1": "0.1 to 0.1",
                "0.0, float('inf'), 0.1": "0.0 to inf",
                "float('nan'), 0.5, 0.1": "nan to 0.5",
                "0.0, '0.5', 0.1": "0.0 to '0.5'",
            }.items()
        ),
        *(
            (
                OWN.replace("    def apply", f"    replaces = {what}\n\n    def apply"),
                "replaces is .*, it may be \\(\\) or \\('v_",
            )
            for what in ('("delta_t_s",)', '("v_swim_m_s")', '["v_swim_m_s"]', '("v_swim_m_s", "k")')
        ),
        (
            OWN.replace('"gain"),', '"gain"), Parameter("a", "1", 0.0, 0.2, 0.1, "more"),'),
            "Boost: parameter 'a' is declared twice",
        ),
        (OWN.replace("0.5, 0.1", "0.5, 0.9"), "a: start 0.9 is not within 0.0 to 0.5"),
        (OWN.replace('0.5, 0.1, "gain"', "0.5"), "TypeError: .* missing 2 required"),
        (OWN.replace('p["a"]', 'p["b"]'), "Boost.apply: KeyError: 'b'"),
        (OWN.replace("chain.k = ", "chain.kk = "), "Boost.apply: AttributeError: 'Chain' object has no attribute 'kk'"),
        (OWN.replace("(1 +", "(float('nan') +"), "Boost.apply: gives no finite number"),
        (
            OWN.replace('"gain")', '"gain", neutral=0.0)').replace("(1 +", "(0.88 +"),
            "Boost.apply: changes something at its neutral value, a = 0, where it must vanish",
        ),
        (
            OWN.replace("(1 +", "(1 + __import__('random').random() *"),
            "Boost.apply: gives another result for the same inputs",
        ),
        (
            OWN.replace("    def apply", "    def __init__(self, x):\n        pass\n\n    def apply"),
            "missing 1 required",
        ),
        (OWN.replace("def apply(self", "def applied(self"), "Boost has no apply"),
    ],
)
def test_refuses_files_that_are_no_effect(tmp_path, text, message):
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        catalogue([path])
    assert "mine.py" in str(raised.value)
    assert "\n" not in str(raised.value)


DOES = '        chain.k = chain.k * (1 + p["a"])'


@pytest.mark.parametrize(
    "slip",
    [
        "if chain.omega > 12:\n            chain.k = chain.k * (1 + p['a'])",
        "chain.k = chain.k * (1 + float(p['a'][0]))",
        "chain.k = chain.k * (1 + p['a'] * float(chain.omega[0]))",
        "chain.k = chain.k * math.exp(p['a'])",
        "chain.k = chain.k * (math.exp(p['a']) if chain.first_step else 1 + p['a'])",
        "chain.k[...] = chain.k * (1 + p['a'])",
        "chain.k = chain.k * np.array([1.0, 1.1])",
    ],
)
def test_a_slip_that_only_arrays_show_is_told_before_any_fit(tmp_path, slip):
    path = tmp_path / "mine.py"
    path.write_text("import math\nimport numpy as np\n" + OWN.replace(DOES, f"        {slip}"))
    with pytest.raises(InputError, match=r"mine.py: Boost.apply: .*; quantities and parameters are arrays") as raised:
        effects_in(path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "right",
    [
        "chain.k *= 1 + p['a']",
        "chain.k = np.where(chain.omega > 12, chain.k * (1 + p['a']), chain.k)",
        "if not chain.first_step:\n            chain.k = chain.k * (1 + p['a'])",
        "chain.k = chain.k * (1 + p['a']) if np.all(chain.k < 300) else chain.k",
    ],
)
def test_what_arrays_can_do_is_an_effect(tmp_path, right):
    path = tmp_path / "mine.py"
    path.write_text("import numpy as np\n" + OWN.replace(DOES, f"        {right}"))
    assert [one.identifier for one in effects_in(path)] == ["boost"]


@pytest.mark.parametrize("nothing", ["return chain.k * (1 + p['a'])", "k = chain.k * (1 + p['a'])"])
def test_an_effect_that_sets_nothing_is_refused(tmp_path, nothing):
    path = tmp_path / "mine.py"
    path.write_text(OWN.replace(DOES, f"        {nothing}"))
    with pytest.raises(InputError, match="changes nothing that is seen; a quantity is changed by setting it"):
        effects_in(path)


def test_an_effect_without_a_number_at_some_phi_is_not_taken_for_one_without_a_neutral_value(tmp_path):
    """Whether a φ beyond the root's range occurs is seen when there are trials."""
    path = tmp_path / "mine.py"
    does = "        chain.k = chain.k * (1 + {}*np.sqrt(0.632 - chain.phi))"
    neutral = OWN.replace('"gain")', '"gain", neutral=0.0)')
    path.write_text("import numpy as np\n" + neutral.replace(DOES, does.format("p['a']")))
    assert [one.identifier for one in effects_in(path)] == ["boost"]
    # Control: it must vanish where it gives a number.
    path.write_text("import numpy as np\n" + neutral.replace(DOES, does.format("(p['a'] + 0.1)")))
    with pytest.raises(InputError, match="changes something at its neutral value, a = 0"):
        effects_in(path)


def test_an_effect_may_replace_the_swimming_speed(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(OWN.replace("    def apply", '    replaces = ("v_swim_m_s",)\n\n    def apply'))
    assert effects_in(path)[0].replaces == ("v_swim_m_s",)


def test_refuses_a_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        effects_in(tmp_path / "none.py")


def test_a_plug_in_that_cannot_be_imported_is_one_line(monkeypatch):
    broken = EntryPoint("sticky", "no_such_module:Sticky", catalogue_module.GROUP)
    monkeypatch.setattr(catalogue_module, "entry_points", lambda **_: [broken])
    with pytest.raises(InputError, match=r"^entry point sticky: can't be loaded: .*no_such_module") as error:
        catalogue()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.identifier)
def test_where_an_effect_is_seen_no_observable_is_called_unchanged(effect):
    """Once k(φ) is fitted, an effect that leaves the lift alone shows in it: maps of residuals would contradict."""
    assert "unchanged" not in effect.seen_in
