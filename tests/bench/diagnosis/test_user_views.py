"""A view in a file of one's own looks beside the others; what is wrong with one is told in a line."""

from __future__ import annotations

import hashlib
import pickle
import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import summarise
from bench.diagnosis.views import registry
from bench.diagnosis.views.registry import (
    SHOWN,
    VIEWS,
    forget_view_files,
    load_view_files,
    same_views,
    shown_views,
    views,
)
from bench.diagnosis.views.response import Response
from protocols.errors import InputError
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Make = tuple[Callable[..., Any], Callable[..., Any]]

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "write-a-view.md"
HEAD = "from bench.diagnosis.views.base import Statistic, View\nimport numpy as np\n"
SHORT = HEAD + 'class Mine(View):\n    id = "mine"\n    title = "mine"\n    def look(self, recording):\n'


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    yield
    forget_view_files()


def file_with(folder: Path, text: str) -> Path:
    path = folder / "my_view.py"
    path.write_text(text)
    return path


def documented(folder: Path) -> Path:
    found = re.search(r"^# file: late_answers.py\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL)
    assert found is not None
    return file_with(folder, found[1])


def taken_at(make: Make, pixel: PixelModel) -> Any:
    """Return a point that a sensor has taken, around its threshold: some answers come late."""
    point, take = make
    return take([point(0, 0.32)], pixel, 3).taken[0]


PIXEL = PixelModel(noise_rms=0.045, corner_hz=50.0, theta_on=0.3, theta_off=0.3, refractory_s=8e-3)


def test_the_documented_view_counts_late_answers(tmp_path: Path, make: Make) -> None:
    load_view_files([documented(tmp_path)])
    assert [v.id for v in views()] == [*(v.id for v in VIEWS), "late_answers"]
    point = taken_at(make, PIXEL)
    recording = Recording(Frame(point), point.events())
    found = summarise(recording, views())
    mine = [i for i, label in enumerate(found.labels) if label.view == "late_answers"]
    assert len(mine) == len(recording.groups) > 0
    assert sum(found.top[mine]) > 0
    for i, answers in zip(mine, recording.groups, strict=True):
        late = np.nansum(answers.latency_s > 0.5 * answers.test.width_s)
        assert found.top[i] == late
        assert found.bottom[i] == answers.answered.sum()


def test_a_view_by_which_no_fit_goes_is_shown_alone(tmp_path: Path) -> None:
    text = SHORT.replace("class Mine(View):\n", "class Mine(View):\n    fitted = False\n") + "        yield 1\n"
    load_view_files([file_with(tmp_path, text)])
    assert views() == VIEWS
    assert [v.id for v in shown_views()] == [*(v.id for v in SHOWN), "mine"]
    assert not any(v.fitted for v in shown_views())


def test_another_process_looks_with_the_same(tmp_path: Path) -> None:
    assert same_views() is None
    path = documented(tmp_path)
    load_view_files([path])
    setup = pickle.loads(pickle.dumps(same_views()))  # noqa: S301 - our own bytes
    forget_view_files()
    setup()
    assert views()[-1].id == "late_answers"
    path.write_text(path.read_text() + "\n# changed\n")
    with pytest.raises(InputError, match="is another file for this worker"):
        setup()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "has no view in it; expected a class derived from View"),
        (HEAD + "class Mine(View):\n    id = 'Mine!'\n", r"my_view.py:3: Mine: id is 'Mine!'"),
        (HEAD + "class Mine(View):\n    id = 'mine'\n", "Mine: has no title"),
        (HEAD + "class Mine(View):\n    id = 'mine'\n    title = 'm'\n", "Mine: does not look"),
        (SHORT + "        return iter(())\n    unit = 1.0\n", "Mine: unit is 1.0; expected text, as 'Hz'"),
        (SHORT.replace('"mine"', '"response"') + "        yield 1\n", "the id response is taken"),
        (SHORT.replace('"mine"', '"latency_50"') + "        yield 1\n", "the id latency_50 is taken"),
        ("def f(:\n", r"my_view.py:1:\d+: is no Python"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_view_files([file_with(tmp_path, text)])
    assert views() == VIEWS


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("        yield 1 / 0\n", r"my_view.py:7: ZeroDivisionError"),
        ("        yield 3\n", "yielded int; expected Statistic"),
        (
            "        yield Statistic('up', 'mean', np.ones(recording.pixels), np.ones(recording.pixels))\n",
            "part 'up'",
        ),
        ("        yield Statistic('on', 'mean', np.ones(3), np.ones(3))\n", "top has 3 numbers; expected"),
        (
            "        yield Statistic('on', 'mean', np.full(recording.pixels, np.nan), np.ones(recording.pixels))\n",
            "expected one finite number",
        ),
    ],
)
def test_what_goes_wrong_in_it_is_one_line(tmp_path: Path, make: Make, body: str, message: str) -> None:
    load_view_files([file_with(tmp_path, SHORT + body)])
    point = taken_at(make, PIXEL)
    with pytest.raises(InputError, match=message):
        summarise(Recording(Frame(point), point.events()), views())


@pytest.fixture
def plug_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Path]]:
    """Return a function that installs a package with entry points, and returns its file."""

    def install(text: str, *values: str) -> Path:
        file = tmp_path / "my_evs_views.py"
        file.write_text(text)
        found = tmp_path / "my_evs_views-1.5.dist-info"
        found.mkdir(exist_ok=True)
        (found / "METADATA").write_text("Metadata-Version: 2.1\nName: my-evs-views\nVersion: 1.5\n")
        lines = [f"point{i} = {value}" for i, value in enumerate(values or ("my_evs_views:Mine",))]
        (found / "entry_points.txt").write_text("\n".join(["[evs_bench.views]", *lines, ""]))
        monkeypatch.syspath_prepend(tmp_path)
        registry._plug_ins.cache_clear()
        return file

    yield install
    sys.modules.pop("my_evs_views", None)
    monkeypatch.undo()
    registry._plug_ins.cache_clear()


COUNTED = "        yield Statistic('on', 'mean', np.ones(recording.pixels), np.ones(recording.pixels))\n"


def test_an_installed_package_brings_views(plug_in: Callable[..., Path], tmp_path: Path, make: Make) -> None:
    file = plug_in(SHORT + COUNTED)
    (source,) = registry._plug_ins()
    assert (source.path, source.package) == (str(file), "my-evs-views 1.5")
    assert source.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    own = tmp_path / "late.py"
    own.write_text(documented(tmp_path).read_text())
    load_view_files([own])
    assert [v.id for v in views()] == [*(v.id for v in VIEWS), "mine", "late_answers"]
    point = taken_at(make, PIXEL)
    found = summarise(Recording(Frame(point), point.events()), views())
    assert [label.view for label in found.labels].count("mine") == 1


def test_without_a_file_another_process_needs_no_telling(plug_in: Callable[..., Path]) -> None:
    plug_in(SHORT + COUNTED)
    assert views()[-1].id == "mine"
    assert same_views() is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", r"plug-in point0 \(my_evs_views:Mine\): cannot be imported: "),
        ("import no_such_module\n", r"cannot be imported: No module named 'no_such_module'"),
        ("Mine = 1\n", r"plug-in point0 \(my_evs_views:Mine\): expected a class derived from View"),
        (HEAD + "class Mine(View):\n    id = 'mine'\n", r"plug-in point0 \(my_evs_views:Mine\): Mine: has no title"),
        (SHORT.replace('"mine"', '"response"') + COUNTED, r"the id response is taken \(a built-in view\)"),
    ],
)
def test_a_package_that_brings_none_is_one_line(plug_in: Callable[..., Path], text: str, message: str) -> None:
    plug_in(text)
    with pytest.raises(InputError, match=message) as error:
        views()
    assert "\n" not in str(error.value)


def test_an_id_of_a_package_is_taken(plug_in: Callable[..., Path], tmp_path: Path) -> None:
    plug_in(SHORT + COUNTED)
    with pytest.raises(InputError, match=r"my_view\.py: the id mine is taken \(of my-evs-views 1\.5\)"):
        load_view_files([file_with(tmp_path, SHORT + COUNTED)])
    plug_in(SHORT + COUNTED, "my_evs_views:Mine", "my_evs_views:Mine")
    with pytest.raises(InputError, match=r"plug-in point1 .*: the id mine is taken \(of my-evs-views 1\.5\)"):
        views()


def test_what_goes_wrong_in_a_package_is_one_line(plug_in: Callable[..., Path], make: Make) -> None:
    plug_in(SHORT + "        yield 1 / 0\n")
    point = taken_at(make, PIXEL)
    with pytest.raises(InputError, match=r"my_evs_views\.py:7: ZeroDivisionError"):
        summarise(Recording(Frame(point), point.events()), views())


def test_entry_points_are_what_the_group_is_called() -> None:
    assert registry.GROUP == "evs_bench.views"
    assert EntryPoint("response", "bench.diagnosis.views.response:Response", registry.GROUP).load() is Response
