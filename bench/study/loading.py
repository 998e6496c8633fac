"""Studies by name or by path, with everything in them checked before anything is run."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from bench.study.schema import Study
from bench.study.tasks import tasks_of
from protocols.errors import InputError, Problem
from protocols.files import parse_model, read_text
from protocols.yaml_strict import read_yaml

if TYPE_CHECKING:
    from bench.study.schema import Variant

__all__ = ["load_study", "studies"]


def studies() -> tuple[str, ...]:
    """Return the names of the studies that come with the bench, sorted."""
    found = (entry.name for entry in files("bench.study.library").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in found if name.endswith(".yaml")))


def load_study(name_or_path: str) -> Study:
    """Return a shipped study by its name, or the study of a file by its path.

    Raises
    ------
    InputError
        There is none, or with everything that is wrong in the file, each with its place; also where a variant cannot
        be shown one of its stimuli.
    """
    if name_or_path in studies():
        source = f"{name_or_path}.yaml"
        text = files("bench.study.library").joinpath(source).read_text(encoding="utf-8")
    elif Path(name_or_path).exists():
        source, text = name_or_path, read_text(name_or_path)
    else:
        hint = f"neither a file nor a shipped one; shipped are {', '.join(studies())}"
        raise InputError(f"there is no study {name_or_path!r}: {hint}")
    study = parse_model(text, Study, source)
    problems = _not_measurable(study, text, source)
    if problems:
        raise InputError(*problems)
    return study


def _not_measurable(study: Study, text: str, source: str) -> list[Problem]:
    """Return a problem for each variant or grid that a protocol cannot be altered for."""
    document = read_yaml(text, source)
    found = []
    places = [(variant, "variants", i) for i, variant in enumerate(study.variants)]
    places += [(v, "grids", i) for i, grid in enumerate(study.grids) for v in grid.variants(quick=False)]
    for variant, key, i in places:
        node = document.children[key].children[i]
        found += [Problem(text, source, node.line, node.column) for text in _complaints(study, variant)]
    return found


def _complaints(study: Study, variant: Variant) -> list[str]:
    try:
        tasks_of(study, variant, 0, quick=True)
    except InputError as error:
        return [p.message for p in error.problems]
    return []
