"""Effects in a file of a user's own, and of installed packages: loading, replacing, refusing."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import subprocess
import sys
from importlib.metadata import EntryPoint
from typing import TYPE_CHECKING

import numpy as np
import pytest

from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain, model_text, read_model_file
from sim_backend.pixel.effects import (
    Leak,
    effect_class,
    effect_from_dict,
    effect_source,
    effects,
    forget_effect_files,
    load_effect_files,
    loaded_effect_files,
    registry,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Write = Callable[..., Path]

HEAD = """\
import math
from dataclasses import dataclass
from sim_backend.pixel.effects import Effect
from sim_backend.pixel.parameters import parameter

"""
CLASS = '''\
@dataclass(frozen=True, slots=True)
class {name}(Effect):
    """A dead time that follows the light."""

    id = "{id}"
    stage = "refractory"

    half_fa: float = parameter("fA", (0.0, 1e6), 10.0, 0.0, "photocurrent")

    def refractory(self, period_s, current_fa, z):
        return {body}

'''
LEAK = PixelModel(theta_on=0.25, noise_rms=0.0, refractory_s=0.02) + Leak(rate_per_s=2.5)


@pytest.fixture(autouse=True)
def _only_here() -> Iterator[None]:
    yield
    forget_effect_files()


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Return a function that writes a file with one effect."""

    def to_file(
        body: str = "period_s * (1.0 + self.half_fa / current_fa)",
        name: str = "mine.py",
        before: str = "",
        **more: str,
    ) -> Path:
        path = tmp_path / name
        path.write_text(HEAD + before + CLASS.format(name="Mine", id=more.get("id", "mine"), body=body))
        return path

    return to_file


def interval_s(effect_id: str = "mine", current_fa: float = 10.0) -> float:
    """Return the interval of a leaking pixel without noise: theta / leak + dead time."""
    model = LEAK + effect_class(effect_id)()
    light = LightHistory.constant(current_fa / model.photoconversion.gain_fa_per_lux)
    chain = build_chain(model, Roi(0, 0, 1, 1), 1)
    events = np.concatenate(list(ReferenceEngine(dt_s=1e-4).events(chain, light, 0.5, 1)))
    return float(np.diff(events["t"])[0] * 1e-6)


def test_a_loaded_effect_is_known_everywhere(write: Write, tmp_path: Path) -> None:
    path = write()
    (source,) = load_effect_files([path])
    assert source.ids == ("mine",)
    assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (source.loaded, source.name, source.path, source.text) == ("file", str(path), str(path), path.read_text())
    assert effects()["mine"] is effect_class("mine") is source.classes[0]
    assert effect_source("mine") is source
    assert effect_source("leak") is None
    model = LEAK + effect_from_dict("mine", {"half_fa": 3.0})
    (tmp_path / "model.yaml").write_text(model_text(model))
    assert read_model_file(tmp_path / "model.yaml") == model
    assert pickle.loads(pickle.dumps(model)) == model  # noqa: S301
    assert interval_s() == pytest.approx(0.1 + 0.02 * 2.0, abs=2e-4)
    forget_effect_files()
    with pytest.raises(InputError, match=r"unknown effect 'mine'.*named with --effects"):
        effect_class("mine")


def test_loading_again_changes_nothing(write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write()
    (first,) = load_effect_files([path])
    monkeypatch.chdir(tmp_path)
    assert load_effect_files(["mine.py", path]) == (first, first)
    assert loaded_effect_files() == (first,)


def test_a_changed_file_takes_the_place_of_what_it_was(write: Write) -> None:
    """Of the same length and in the same second: neither bytecode nor machine code is kept."""
    load_effect_files([write("period_s * 2.0")])
    assert interval_s() == pytest.approx(0.14, abs=2e-4)
    path = write("period_s * 3.0")
    load_effect_files([path])
    assert interval_s() == pytest.approx(0.16, abs=2e-4)
    assert len(loaded_effect_files()) == 1
    assert not (path.parent / "__pycache__").exists()


SCRIPT = """\
import json, sys
import numpy as np
from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.effects import Leak, effect_class, load_effect_files

load_effect_files([sys.argv[1]])
model = PixelModel(theta_on=0.25, noise_rms=0.0, refractory_s=0.02) + Leak(rate_per_s=2.5) + effect_class("mine")()
light = LightHistory.constant(10.0 / model.photoconversion.gain_fa_per_lux)
chain = build_chain(model, Roi(0, 0, 1, 1), 1)
events = np.concatenate(list(ReferenceEngine(dt_s=1e-4).events(chain, light, 0.5, 1)))
print(json.dumps(np.diff(events["t"]).tolist()))
"""


@pytest.mark.slow
def test_a_changed_file_changes_the_result_of_the_next_process(write: Write, tmp_path: Path) -> None:
    """With one cache of compiled code for both."""
    found = []
    for factor in (2, 3):
        path = write("longer(period_s)", before=f"def longer(period_s):\n    return period_s * {factor}.0\n\n\n")
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(path)], env=os.environ, capture_output=True, text=True, check=True
        )
        found.append(json.loads(done.stdout)[0] * 1e-6)
    assert found == pytest.approx([0.14, 0.16], abs=2e-4)


@pytest.mark.slow
def test_a_spawned_process_finds_the_same_classes(write: Write) -> None:
    path = write()
    load_effect_files([path])
    code = (
        "import pickle, sys\nfrom sim_backend.pixel.effects import load_effect_files\n"
        "load_effect_files(sys.argv[1:])\nprint(pickle.load(sys.stdin.buffer))"
    )
    model = LEAK + effect_from_dict("mine", {"half_fa": 3.0})
    done = subprocess.run(
        [sys.executable, "-c", code, *(source.path for source in loaded_effect_files())],
        input=pickle.dumps(model), capture_output=True, check=True,
    )  # fmt: skip
    assert done.stdout.decode().strip() == str(model)


def test_helpers_constants_and_no_parameters(tmp_path: Path) -> None:
    text = HEAD + (
        "FACTOR = 2.0\n\n"
        "def inner(x):\n    return math.sqrt(x) * FACTOR\n\n"
        "def outer(x):\n    return inner(x) * inner(x)\n\n"
        "@dataclass(frozen=True, slots=True)\nclass A(Effect):\n    id = 'mine'\n    stage = 'refractory'\n"
        "    def refractory(self, period_s, current_fa, z):\n        return outer(period_s)\n\n"
        "@dataclass(frozen=True, slots=True)\nclass B(Effect):\n    id = 'other'\n    stage = 'comparators'\n"
        "    def thresholds(self, on, off, current_fa, since_s, z):\n        return on, 1\n\n"
    )
    (tmp_path / "two.py").write_text(text)
    (source,) = load_effect_files([tmp_path / "two.py"])
    assert source.ids == ("mine", "other")
    assert interval_s() == pytest.approx(0.1 + 4.0 * 0.02, abs=2e-4)
    assert interval_s("other") == pytest.approx(0.12, abs=2e-4)


BAD_CLASSES = {
    "id = 'Mine'\n    stage = 'refractory'": r"mine\.py:6: Mine: id is 'Mine'; expected a name of small letters",
    "id = 'mine'\n    stage = 'lens'": r"mine\.py:6: Mine: stage is 'lens'; expected one of light, photocurrent",
    "id = 'mine'\n    stage = 'light'": r"mine\.py:6: Mine: does nothing; expected apply or one of light, response",
    "id = 'mine'\n    stage = 'light'\n    gain: float = 1.0": r"field gain is no parameter; expected gain: float =",
    "id = 'mine'\n    stage = 'light'\n    apply = None": (
        r"mine\.py:6: Mine: apply takes other arguments; expected apply\(self, chain, draws\)"
    ),
    "id = 'mine'\n    stage = 'light'\n    leak: float = parameter('1', (0.0, 1.0), 0.0, 0.0, '')": (
        r"leak is the name of a hook; choose another for the parameter"
    ),
    "id = 'mine'\n    stage = 'light'\n    def leak(self, rate):\n        return rate": (
        r"leak takes other arguments; expected leak\(self, rate_per_s, current_fa\)"
    ),
    "id = 'mine'\n    stage = 'light'\n    gain: float = parameter('1', (0.0, 1.0), 2.0, 0.0, '')\n"
    "    def apply(self, chain, draws):\n        return chain": (
        r"mine\.py:6: effect mine: gain is 2\.0; expected a number from 0 to 1"
    ),
    "id = 'leak'\n    stage = 'light'\n    def apply(self, chain, draws):\n        return chain": (
        r"mine\.py: the id leak is taken \(built in\); choose another"
    ),
}


@pytest.mark.parametrize("body", BAD_CLASSES)
def test_a_class_that_is_no_effect_is_refused(body: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(f"{HEAD}@dataclass(frozen=True, slots=True)\nclass Mine(Effect):\n    {body}\n")
    with pytest.raises(InputError, match=BAD_CLASSES[body]) as error:
        load_effect_files([tmp_path / "mine.py"])
    assert "\n" not in str(error.value)
    assert loaded_effect_files() == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\ny = (\n", r"bad\.py:2:5: is no Python: '\(' was never closed"),
        ("x = 1\ny = undefined\n", r"bad\.py:2: NameError: name 'undefined' is not defined"),
        ("import no_such_module\n", r"bad\.py:1: ModuleNotFoundError: No module named 'no_such_module'"),
        ("import sys\nsys.exit(3)\n", r"bad\.py:2: SystemExit: 3"),
        ("class Mine:\n    id = 'mine'\n", r"bad\.py: has no effect in it; expected a class derived from Effect"),
        (
            HEAD + "class Mine(Effect):\n    id = 'mine'\n    stage = 'light'\n",
            r"bad\.py:6: Mine: is no frozen datac",
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_one_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_effect_files([tmp_path / "bad.py"])
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere\.py: cannot be read"):
        load_effect_files([tmp_path / "nowhere.py"])


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            "period_s * self.half",
            r"mine\.py:\d+: effect mine: refractory cannot be compiled: Unknown attribute 'half'",
        ),
        ("period_s * undefined", r"mine\.py:15: .* cannot be compiled: NameError: name 'undefined' is not defined"),
        ("period_s + 'a'", r"mine\.py:16: effect mine: refractory cannot be compiled: there is no add\(float64, "),
        ("None", r"mine\.py:15: effect mine: refractory gives none; expected a number whatever it is given"),
        ("None if z > 0 else 1.0", r"refractory gives OptionalType\(float64\); expected a number"),
        ("[period_s, z]", r"refractory gives .*; expected a number"),
        ("fail(period_s)", r"refractory raises an error, which a compiled function cannot; return nan"),
    ],
)
def test_a_hook_that_cannot_be_compiled_is_one_line(body: str, message: str, write: Write) -> None:
    path = write(body, before="def fail(x):\n    raise ValueError(x)\n" if "fail" in body else "")
    with pytest.raises(InputError, match=message) as error:
        load_effect_files([path])
    assert "\n" not in str(error.value)


def test_an_id_can_be_taken_by_another_file(write: Write) -> None:
    load_effect_files([write()])
    with pytest.raises(InputError, match=r"second\.py: the id mine is taken \(of .*mine\.py\); choose another"):
        load_effect_files([write(name="second.py")])


def test_an_id_can_stand_twice_in_a_file(write: Write) -> None:
    path = write(before=CLASS.format(name="First", id="mine", body="period_s"))
    with pytest.raises(InputError, match=r"the id mine is taken \(twice in it\)"):
        load_effect_files([path])


@pytest.fixture
def plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str], None]]:
    """Return a function that installs a package with an entry point."""

    def install(text: str, value: str) -> None:
        (tmp_path / "my_evs_effects.py").write_text(text)
        found = tmp_path / "my_evs_effects-1.5.dist-info"
        found.mkdir(exist_ok=True)
        (found / "METADATA").write_text("Metadata-Version: 2.1\nName: my-evs-effects\nVersion: 1.5\n")
        (found / "entry_points.txt").write_text(f"[evs_bench.effects]\nmine = {value}\n")
        monkeypatch.syspath_prepend(tmp_path)
        registry._plug_ins.cache_clear()

    yield install
    sys.modules.pop("my_evs_effects", None)
    monkeypatch.undo()
    registry._plug_ins.cache_clear()


def test_an_installed_package_brings_effects(plug_in: Callable[[str, str], None], tmp_path: Path) -> None:
    plug_in(HEAD + CLASS.format(name="Mine", id="mine", body="period_s * 2.0"), "my_evs_effects:Mine")
    source = effect_source("mine")
    assert source is not None
    assert (source.name, source.loaded, source.package) == ("mine", "entry point", "my-evs-effects 1.5")
    assert source.sha256 == hashlib.sha256((tmp_path / "my_evs_effects.py").read_bytes()).hexdigest()
    assert interval_s() == pytest.approx(0.14, abs=2e-4)


@pytest.mark.parametrize(
    ("text", "value", "message"),
    [
        ("x = 1\n", "my_evs_effects:Mine", r"plug-in mine \(my_evs_effects:Mine\): cannot be imported: "),
        ("Mine = 1\n", "my_evs_effects:Mine", "expected a class derived from Effect"),
        (HEAD + CLASS.format(name="Mine", id="leak", body="z"), "my_evs_effects:Mine", "the id leak is taken"),
    ],
)
def test_a_package_that_brings_none_is_one_line(
    plug_in: Callable[[str, str], None], text: str, value: str, message: str
) -> None:
    plug_in(text, value)
    with pytest.raises(InputError, match=message):
        effects()


def test_a_hook_of_a_package_that_cannot_be_compiled_is_told_at_the_run(plug_in: Callable[[str, str], None]) -> None:
    plug_in(HEAD + CLASS.format(name="Mine", id="mine", body="period_s * self.half"), "my_evs_effects:Mine")
    with pytest.raises(InputError, match=r"my_evs_effects\.py:\d+: .* cannot be compiled: Unknown attribute 'half'"):
        interval_s()


def test_entry_points_are_what_the_group_is_called() -> None:
    assert registry.GROUP == "evs_bench.effects"
    assert EntryPoint("leak", "sim_backend.pixel.effects:Leak", registry.GROUP).load() is Leak
