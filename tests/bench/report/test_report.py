"""The page and its files."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from html.parser import HTMLParser
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.analysis.results import Analysis, SCurve
from bench.report import ModelTrace, write_report

if TYPE_CHECKING:
    from pathlib import Path

Maker = Callable[..., Any]
VOID = {"meta", "img", "link", "br", "hr", "input"}
EVIL = "<script>alert('x')</script> & \"quotes\" </title><img src=http://example.org/x>"


class Page(HTMLParser):
    """Collects what a page loads and shows, and sees that its tags match."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.loads: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self.text = ""
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "srcset", "data", "action"):
                self.loads.append(value or "")
            elif name == "href":
                self.links.append(value or "")
            elif name == "id":
                self.ids.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in ("style", "script"):
            self.text += data


def with_changes(analysis: Analysis, **changed: Any) -> Analysis:
    values = {name: getattr(analysis, name) for name in Analysis.__slots__}
    return Analysis(**{**values, **changed})


@pytest.fixture(scope="module")
def family_page(tmp_path_factory: pytest.TempPathFactory, family_analysis: Analysis, run_of: Maker) -> Path:
    folder = tmp_path_factory.mktemp("family") / "report"
    t_s = np.linspace(0.0, 2.0, 400)
    trace = ModelTrace(t_s, 0.3 * np.sin(20.0 * t_s), 0.35, 0.3)
    return write_report(run_of(points=64), family_analysis, folder, model_trace=trace)


def test_nothing_is_loaded_from_anywhere(family_page: Path) -> None:
    page = Page(family_page)
    assert page.loads
    assert all(address.startswith("data:image/svg+xml;base64,") for address in page.loads)
    assert not {"script", "link", "iframe", "object", "embed"} & set(page.tags)
    assert not re.search(r"url\(|@import|https?://", page.source)


def test_figures_lie_beside_the_page_as_png_and_pdf(family_page: Path) -> None:
    page = Page(family_page)
    names = {"s_curves", "thresholds", "background", "pixel", "latency", "resets", "pixel_thresholds", "event_map"}
    assert set(page.ids) == names
    figures = {link for link in page.links if link.startswith("figures/")}
    assert figures == {f"figures/{name}.{kind}" for name in names for kind in ("png", "pdf")}
    for link in sorted(figures):
        content = (family_page.parent / link).read_bytes()
        assert content.startswith(b"\x89PNG\r\n" if link.endswith("png") else b"%PDF-")
        assert len(content) > 8_000


def test_tables_lie_beside_the_page_as_csv(family_page: Path) -> None:
    tables = [link for link in Page(family_page).links if link.startswith("tables/")]
    rows = {link: (family_page.parent / link).read_text().splitlines() for link in tables}
    assert len(rows["tables/responses.csv"]) == 1 + 480
    assert len(rows["tables/curves.csv"]) == 1 + 16


def test_key_results_stand_in_the_page(family_page: Path) -> None:
    text = Page(family_page).text
    assert "76 mlux" in text
    assert "0.799" in text  # the threshold at 76 mlux, as the analysis has it
    assert "0.791 to 0.807" in text
    assert "3 pulses were left out" in text
    assert "93.0 % of resets were answered" in text
    assert "ON 76 mlux, OD 3" in text
    assert "IMX636" in text
    assert "python 3.12.3" in text
    assert "it was not measured" in text
    assert "nan" not in re.sub(r"[a-z]*nan[a-z]+|[a-z]+nan[a-z]*", "", text.lower())


@pytest.mark.slow
def test_the_same_run_gives_the_same_bytes(family_analysis: Analysis, run_of: Maker, tmp_path: Path) -> None:
    smaller = with_changes(
        family_analysis, responses=family_analysis.responses[:30], curves=family_analysis.curves[:2]
    )
    pages = [write_report(run_of(points=2), smaller, tmp_path / name) for name in ("first", "second")]
    files = [sorted(p for p in page.parent.rglob("*") if p.is_file()) for page in pages]
    assert [p.name for p in files[0]] == [p.name for p in files[1]]
    for one, other in zip(*files, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_what_comes_from_files_is_escaped(constant: Analysis, constant_run_of: Maker, tmp_path: Path) -> None:
    run = constant_run_of(EVIL, software={"python": EVIL, EVIL: "1"})
    page = Page(write_report(run, with_changes(constant, warnings=(EVIL,)), tmp_path))
    assert "script" not in page.tags
    assert page.text.count("<script>alert('x')</script>") >= 4
    assert all(address.startswith("data:") for address in page.loads)


def test_a_run_of_constant_light(constant: Analysis, constant_run_of: Maker, tmp_path: Path) -> None:
    page = Page(write_report(constant_run_of("dark noise"), constant, tmp_path))
    assert set(page.ids) == {"background", "pixel", "event_map"}
    assert "0.0214" in page.text  # 41 events in 1920 pixel-seconds
    assert "< 0.00156" in page.text
    assert "50 % point" not in page.text


def empty_curves(key_of: Maker, curve_of: Maker, unknown: Maker) -> list[SCurve]:
    """Return curves that analysis could make nothing of."""
    nothing = unknown("ln", "the curve is flat")
    known: dict[str, Any] = {
        "half": nothing, "intercept": nothing, "floor": nothing, "plateau": nothing, "noise_rms": None,
        "fit_contrast": np.zeros(0), "fit_probability": np.zeros(0), "answered_resets": math.nan,
    }  # fmt: skip
    nan = np.full(6, np.nan)
    flat = curve_of(key_of("on", 1.0), np.linspace(0.1, 0.6, 6), theta=None, **known)
    known_nan = {**known, "probability": nan, "low": nan, "high": nan, "theta": nothing}
    blank = curve_of(key_of("on", 2.0), np.linspace(0.1, 0.6, 6), **known_nan)
    missing = curve_of(key_of("off", 3.0), np.zeros(0), theta=None, **known)
    single = curve_of(key_of("off", 4.0), np.array([0.3]), theta=None, limited_by="on", **known)
    return [flat, blank, missing, single]


def test_curves_that_say_nothing_do_no_harm(key_of: Maker, curve_of: Maker, unknown: Maker, row_of: Maker,
                                            run_of: Maker, constant: Analysis, tmp_path: Path) -> None:  # fmt: skip
    row = row_of(key_of("on", 1.0), 0, 0.3, 0.0, low=math.nan, high=math.nan, answered_resets=math.nan)
    curves = tuple(empty_curves(key_of, curve_of, unknown))
    analysis = with_changes(constant, curves=curves, responses=(row,), background=(), warnings=())
    page = Page(write_report(run_of(points=1), analysis, tmp_path))
    assert "s_curves" in page.ids
    assert "thresholds" not in page.ids
    assert "the curve is flat" in page.text
    assert "limited by the ON threshold" in page.text


def test_an_empty_run_still_has_a_page(run_of: Maker, constant: Analysis, tmp_path: Path) -> None:
    analysis = with_changes(constant, background=(), event_map=np.zeros((0, 0), np.int64))
    page = Page(write_report(run_of(points=0), analysis, tmp_path))
    assert page.ids == []
    assert "No S-curve and no background rate" in page.text


def test_the_styles_of_the_caller_are_left_alone(run_of: Maker, constant: Analysis, tmp_path: Path) -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    write_report(run_of(points=0), constant, tmp_path)
    assert dict(mpl.rcParams) == before
